"""CARLA's own tests and examples against the stand-in: the script that runs them, and its record.

With ``CARLA_PYTHONAPI`` (a checkout of CARLA 0.9.16) they are run, which takes half an hour; with
``CARLA_TOWNS`` (a folder with its TownNN.xodr) on its towns.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath

import pytest

from ..scripts import script
from .serving import Serving

pytest.importorskip("carla", reason="the wheel 'carla' is not installed")

ROOT = FilePath(__file__).resolve().parents[2]
RECORD = ROOT / "results/carla/api.json"
api = script("benchmarks/carla_api.py")
tables = script("benchmarks/tables.py")

TESTS = """
import unittest
import carla

class TestWorld(unittest.TestCase):
    def setUp(self):
        self.world = carla.Client("localhost", 3654).get_world()

    def test_map(self):
        self.assertTrue(self.world.get_map().get_spawn_points())

    def test_ray(self):
        self.world.cast_ray(carla.Location(), carla.Location(x=1.0))
"""
ENDLESS = """
import carla, time
world = carla.Client("localhost", 2000).get_world()
print(world.get_map().name, flush=True)
while True:
    time.sleep(0.01)
"""


@pytest.fixture
def checkout(tmp_path: FilePath) -> FilePath:
    """One with a module of tests, and an example that does not end."""
    for folder in ("test/smoke", "examples", "util", "carla"):
        (tmp_path / "PythonAPI" / folder).mkdir(parents=True)
    (tmp_path / "PythonAPI/test/smoke/__init__.py").touch()
    (tmp_path / "PythonAPI/test/smoke/test_world.py").write_text(TESTS, encoding="utf-8")
    (tmp_path / "PythonAPI/examples/endless.py").write_text(ENDLESS, encoding="utf-8")
    (tmp_path / "PythonAPI/util/broken.py").write_text("import absent_module\n", encoding="utf-8")
    return tmp_path


def test_it_tells_what_passes_and_why_not(
    checkout: FilePath, server: Serving, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def running(_: object) -> Iterator[int]:
        yield server.port

    monkeypatch.setattr(api, "standin", running)
    monkeypatch.setattr(api, "SECONDS", 4.0)
    found = api.run(checkout, None, [])
    rows = {(row["program"], row["what"]): (row["outcome"], row["said"]) for row in found["rows"]}
    assert rows["smoke/test_world.py", "test_map"] == ("passes", "")
    outcome, said = rows["smoke/test_world.py", "test_ray"]
    assert outcome == "fails"
    assert said.startswith("RuntimeError: stand-in: ")
    assert rows["examples/endless.py", ""] == ("passes", "until it is interrupted")
    outcome, said = rows["util/broken.py", ""]
    assert (outcome, said) == ("fails", "ModuleNotFoundError: No module named 'absent_module'")
    assert len(rows) == 4
    text = tables.of_programs(found["rows"])
    assert "| `examples/endless.py` |  | passes | until it is interrupted |" in text
    # Run again alone, it takes its old place among the others.
    again = {**found, "rows": [{**found["rows"][-2], "outcome": "fails"}]}
    assert [row["outcome"] for row in api.merged(found, again)["rows"]] == [
        *("passes", "fails", "fails", "fails")
    ]


def test_the_page_shows_the_record() -> None:
    record = json.loads(RECORD.read_text(encoding="utf-8"))
    page = (ROOT / "docs/carla_standin.md").read_text(encoding="utf-8")
    assert "<!-- results/carla/api.json -->\n" + tables.of_programs(record["rows"]) in page


@pytest.mark.skipif("CARLA_PYTHONAPI" not in os.environ, reason="no CARLA_PYTHONAPI")
def test_what_passed_still_passes(capsys: pytest.CaptureFixture[str]) -> None:
    towns = os.environ.get("CARLA_TOWNS")
    checkout = FilePath(os.environ["CARLA_PYTHONAPI"])
    with capsys.disabled():
        found = api.run(checkout, None if towns is None else FilePath(towns), [])
    record = json.loads(RECORD.read_text(encoding="utf-8"))
    now = {(row["program"], row["what"]): row["outcome"] for row in found["rows"]}
    if found["towns"] == record["towns"]:
        for row in record["rows"]:
            if row["outcome"] == "passes":
                assert now.get((row["program"], row["what"]), "passes") == "passes", row
