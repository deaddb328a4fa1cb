"""CARLA's own smoke tests, examples and tools, run against the stand-in: which of them pass.

    python benchmarks/carla_api.py CHECKOUT [--source TEXT] [--towns DIR] [--only NAME ...]
                                   [--out FILE.json]

TEXT says in FILE.json where the programs come from. With ``--only``, FILE.json keeps its rows of
the other programs.

CHECKOUT is one of CARLA 0.9.16, or its folder PythonAPI; none of it is part of this project, and
none of its files is changed. Each program runs in a process of its own, in an empty folder, against
a server of its own; ``carla.Client`` is led to that server's port, whatever the program asks for. A
test passes as its own framework says. An example or a tool passes if it ends by itself without an
error, or runs until it is interrupted after SECONDS without one; windows are not drawn (SDL's
driver "dummy").

DIR has CARLA's towns as TownNN.xodr. For towns that the tests load and that are not in it, a copy
of the first one there goes by their name: what a test finds on it is not what it would find in that
town. Each program begins in the first of them, and in the stand-in's straight if there is none.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from steersman.files import write_text
from steersman.provenance import provenance

SERVE = (sys.executable, "-c", "from steersman.cli import main; main()", "carla", "serve")
# How long an example runs, and how long a module of tests may take [s].
SECONDS, PATIENCE = 12.0, 600.0
TOWNS = ("Town01", "Town02", "Town03", "Town04", "Town05", "Town10HD")
# Programs that do not end by themselves, or do something useful, with these arguments.
ARGUMENTS = {
    "automatic_control.py": ["--sync"],
    "manual_control.py": ["--sync"],
    "generate_traffic.py": ["-n", "5", "-w", "2"],
    "start_recording.py": ["-t", "2"],
    "config.py": ["--inspect"],
    "lidar_to_camera.py": ["--frames", "20"],
    "environment.py": ["--cars", "None"],
}
# What is not tried, and why.
LEFT_OUT = {
    "manual_control_carsim.py": "needs CarSim",
    "manual_control_chrono.py": "needs a server built with Chrono",
    "manual_control_steeringwheel.py": "needs a steering wheel",
    "manual_control_rss.py": "needs a client built with RSS",
    "invertedai_traffic.py": "needs a service on the internet",
    "open3d_lidar.py": "needs Open3D",
    "osm_to_xodr.py": "needs a file of OpenStreetMap",
    "extract_spawn_points.py": "needs a file of a map",
}
# Runs one program: its client is led to the port of the server.
LEAD = """
import json, runpy, sys, unittest
import carla
kind, port, what, folder, *arguments = sys.argv[1:]
real = carla.Client
client = real("127.0.0.1", int(port))
client.set_timeout(60.0)
for town in [name for name in client.get_available_maps() if "Town" in name][:1]:
    client.load_world(town)
carla.Client = lambda host="", port_=0, *rest, **named: real("127.0.0.1", int(port), *rest, **named)
if kind == "program":
    sys.argv = [what, *arguments]
    sys.path.insert(0, folder)
    runpy.run_path(what, run_name="__main__")
else:
    sys.path.insert(0, folder)
    class Told(unittest.TestResult):
        def told(self, test, outcome, said=""):
            print("TOLD", json.dumps([test.id(), outcome, said]), flush=True)
        def addSuccess(self, test):
            self.told(test, "passes")
        def addSkip(self, test, reason):
            self.told(test, "skipped", reason)
        def addError(self, test, error):
            self.told(test, "fails", f"{error[0].__name__}: {error[1]}")
        addFailure = addError
    tests = unittest.defaultTestLoader.loadTestsFromName(what)
    print("COUNT", tests.countTestCases(), flush=True)
    tests.run(Told())
"""


@contextmanager
def standin(maps: Path | None) -> Iterator[int]:
    """The port of a running server."""
    options = [] if maps is None else ["--maps", str(maps)]
    server = subprocess.Popen(
        [*SERVE, "--port", "0", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert server.stdout is not None
        found = re.search(r":(\d+), streams on", server.stdout.readline())
        assert found is not None
        yield int(found[1])
    finally:
        server.terminate()
        server.wait(PATIENCE)


def lead(kind: str, what: str, folder: Path, arguments: list[str], maps: Path | None) -> list[str]:
    """Run one program: outcome, what it said last, and all of its standard output."""
    environment = {**os.environ, "SDL_VIDEODRIVER": "dummy", "SDL_AUDIODRIVER": "dummy"}
    with standin(maps) as port, tempfile.TemporaryDirectory() as empty:
        process = subprocess.Popen(
            [sys.executable, "-c", LEAD, kind, str(port), what, str(folder), *arguments],
            cwd=empty,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        interrupted = False
        try:
            out, err = process.communicate(timeout=SECONDS if kind == "program" else PATIENCE)
        except subprocess.TimeoutExpired:
            interrupted = True
            process.send_signal(signal.SIGINT)
            try:
                out, err = process.communicate(timeout=20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                out, err = process.communicate()
    errors = re.findall(r"^(?:[\w.]+(?:Error|Exception)\b.*|terminate called.*)", err, re.MULTILINE)
    last = errors[-1] if errors else ""
    if kind == "tests":
        return ["", f"stopped after {PATIENCE:g} s" if interrupted else last, out]
    if last or (process.returncode and not interrupted):
        return ["fails", last or f"exit code {process.returncode}", out]
    return ["passes", "until it is interrupted" if interrupted else "", out]


def smoke(tests: Path, only: list[str], maps: Path | None) -> Iterator[dict[str, str]]:
    """Each smoke test, and how it ended."""
    for file in sorted((tests / "smoke").glob("test_*.py")):
        if only and file.name not in only:
            continue
        _, last, out = lead("tests", f"smoke.{file.stem}", tests, [], maps)
        told = [json.loads(line[5:]) for line in out.splitlines() if line.startswith("TOLD ")]
        for name, outcome, said in told:
            yield row(f"smoke/{file.name}", name.rpartition(".")[2], outcome, said)
        count = re.search(r"^COUNT (\d+)$", out, re.MULTILINE)
        if count is None:
            yield row(f"smoke/{file.name}", "", "fails", last)
        elif len(told) < int(count[1]):
            said = f"{len(told)} of {count[1]} tests ended; {last}"
            yield row(f"smoke/{file.name}", "", "fails", said)


def programs(folder: Path, only: list[str], maps: Path | None) -> Iterator[dict[str, str]]:
    """Each example or tool, and how it ended."""
    for file in sorted(folder.glob("*.py")):
        if only and file.name not in only:
            continue
        name = f"{folder.name}/{file.name}"
        if file.name in LEFT_OUT:
            yield row(name, "", "not tried", LEFT_OUT[file.name])
            continue
        arguments = ARGUMENTS.get(file.name, [])
        outcome, said, _ = lead("program", str(file), folder.parent / "carla", arguments, maps)
        yield row(name, " ".join(arguments), outcome, said)


def row(program: str, what: str, outcome: str, said: str) -> dict[str, str]:
    """A line of the record; paths and long lists in what was said are shortened."""
    said = re.sub(r"/[\w./-]*/", "", said.strip().partition("\n")[0])
    found = {"program": program, "what": what, "outcome": outcome, "said": said[:160]}
    print("  ".join(found.values()), flush=True)  # noqa: T201 - its output
    return found


@contextmanager
def towns(folder: Path | None) -> Iterator[Path | None]:
    """A folder with a map by the name of every town that the tests load."""
    if folder is None:
        yield None
        return
    with tempfile.TemporaryDirectory() as made:
        files = sorted(folder.glob("Town*.xodr"))
        for file in files:
            shutil.copy(file, made)
        for town in TOWNS:
            if not (Path(made) / f"{town}.xodr").exists():
                shutil.copy(files[0], Path(made) / f"{town}.xodr")
        yield Path(made)


def run(checkout: Path, folder: Path | None, only: list[str]) -> dict[str, Any]:
    """All programs of a checkout, or only those; the record."""
    api = checkout / "PythonAPI" if (checkout / "PythonAPI").is_dir() else checkout
    with towns(folder) as maps:
        rows = [
            *smoke(api / "test", only, maps),
            *programs(api / "examples", only, maps),
            *programs(api / "util", only, maps),
        ]
    own = sorted(f.stem for f in folder.glob("Town*.xodr")) if folder else []
    return {
        "what": "CARLA's smoke tests, examples and tools against the stand-in",
        "client": version("carla"),
        "towns": own,
        "rows": rows,
    }


def merged(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    """A record in which the programs that were run anew have their new rows, in their old place."""
    again = {each["program"] for each in new["rows"]}
    rows: list[dict[str, str]] = []
    for each in old["rows"]:
        if each["program"] not in again:
            rows.append(each)
        elif not any(one["program"] == each["program"] for one in rows):
            rows += [one for one in new["rows"] if one["program"] == each["program"]]
    return {**new, "rows": rows}


def main() -> None:
    """Run them, print a line for each, write the record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--source", default="")
    parser.add_argument("--towns", type=Path)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    found = run(given.checkout, given.towns, given.only)
    found |= {"source": given.source, "commits": [provenance()["commit"]]}
    found |= {"versions": provenance()["versions"]}
    if given.out is not None:
        if given.only and given.out.exists():
            old = json.loads(given.out.read_text(encoding="utf-8"))
            found = merged(old, {**found, "commits": old["commits"] + found["commits"]})
        write_text(given.out, json.dumps(found, indent=1) + "\n")
    passes = [each["outcome"] for each in found["rows"]]
    line = f"{passes.count('passes')} pass, {passes.count('fails')} fail"
    print(line)  # noqa: T201 - its output


if __name__ == "__main__":
    main()
