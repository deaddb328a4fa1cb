"""The way from a tuning to a running binary, as docs/deploy.md has it, with the time of each step.

    python benchmarks/deploy_walk.py [--out results/export/walk.json]

The page's commands run one after the other in a folder with nothing but examples/steer.c.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from steersman.episode import Episode, load_episode
from steersman.files import write_text
from steersman.provenance import provenance

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "deploy.md"
PROGRAM = ROOT / "examples" / "steer.c"
HEADING = "## From a tuning to a running binary"
COMPARED = ("x", "y", "psi", "steer", "steer_command")


def lines() -> list[str]:
    """The commands of the page."""
    part = PAGE.read_text(encoding="utf-8").partition(HEADING)[2].partition("\n## ")[0]
    block = re.findall(r"```sh\n(.*?)```", part, re.S)[0]
    return [line.partition("  #")[0].strip() for line in block.splitlines()]


def walk(folder: Path, run: Callable[[str], object]) -> Iterator[dict[str, Any]]:
    """Run the commands in ``folder``, which is the current one; each with its time [s]."""
    (folder / "examples").mkdir()
    shutil.copy(PROGRAM, folder / "examples")
    for line in lines():
        begun = time.perf_counter()
        run(line)
        yield {"command": line, "seconds": round(time.perf_counter() - begun, 1)}


def apart(one: Episode, other: Episode) -> float:
    """Largest difference of two drives' positions, headings and steering."""
    pairs = ((one[name], other[name]) for name in COMPARED)
    return max(float(abs(a - b).max()) for a, b in pairs)


def driven(folder: Path) -> tuple[Episode, Episode]:
    """The drives by the binary and by Python."""
    binary, python = (folder / "runs" / name / "episode.npz" for name in ("binary", "python"))
    return load_episode(binary), load_episode(python)


def main() -> None:
    """Walk, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        steps = list(
            walk(folder, lambda line: subprocess.run(line, shell=True, check=True, cwd=folder))
        )
        found = {"steps": steps, "seconds": round(sum(each["seconds"] for each in steps), 1)}
        found |= {"binary_from_python": apart(*driven(folder)), **provenance()}
    print(json.dumps(found, indent=1))  # noqa: T201 - its output
    if arguments.out is not None:
        write_text(arguments.out, json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
