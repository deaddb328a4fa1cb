"""How long a new user needs: the first commands of docs/README.md, in a fresh clone.

    python benchmarks/first_drive.py [--out results/benchmarks/first_drive.json]

Clones the repository's last commit into a temporary folder and runs what stands there, line by
line: an empty environment, the installation, the first drive (which compiles the kernels) and the
report. What it takes depends on the network and on pip's cache most of all.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from steersman.files import write_text
from steersman.provenance import provenance

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
# Blocks at the head of the page: install; drive and report.
BLOCKS = 2


def run(line: str, folder: Path) -> float:
    """Seconds that a line takes, in the shell of somebody who has activated the environment."""
    environment = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "VIRTUAL_ENV"}}
    environment["PIP_NO_CACHE_DIR"] = "1"
    environment["PATH"] = f"{folder / '.venv' / 'bin'}{os.pathsep}{environment['PATH']}"
    begun = time.monotonic()
    subprocess.run(line, shell=True, cwd=folder, env=environment, check=True)
    return round(time.monotonic() - begun, 1)


def main() -> None:
    """Clone, run, and print or write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    out = parser.parse_args().out
    text = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    lines = [line for block in BLOCK.findall(text)[:BLOCKS] for line in block.splitlines()]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "steersman"
        begun = time.monotonic()
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
        steps = {"git clone": round(time.monotonic() - begun, 1)}
        steps |= {line: run(line, folder) for line in lines}
    result = {
        **provenance(),
        "cpus": os.cpu_count(),
        "machine": platform.machine(),
        "packages_from": "a mirror in the same network, pip's cache off",
        "seconds": steps,
        "total_s": round(sum(steps.values()), 1),
    }
    written = json.dumps(result, indent=1) + "\n"
    if out is None:
        sys.stdout.write(written)
    else:
        write_text(out, written)


if __name__ == "__main__":
    main()
