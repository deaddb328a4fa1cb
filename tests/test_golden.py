"""Golden runs: what the package computes is what it computed, but for the last bits."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import pytest
import yaml

from .scripts import script

HERE = FilePath(__file__).resolve().parent
FILE = HERE.parent / "benchmarks" / "golden.py"
KEPT = json.loads((HERE / "golden" / "small.json").read_text(encoding="utf-8"))["runs"]
TOLERANCES = yaml.safe_load(FILE.with_suffix(".yaml").read_text(encoding="utf-8"))["tolerances"]
golden = script("benchmarks/golden.py")


@pytest.mark.parametrize("name", KEPT)
def test_the_small_set_is_computed_as_before(name: str) -> None:
    found = _recorded(name)
    assert found.keys() == KEPT[name].keys()
    tolerance = TOLERANCES.get(name, 1e-7)
    apart = {
        key: (KEPT[name][key], each)
        for key, each in found.items()
        if not golden.close(KEPT[name][key], each, tolerance)
    }
    assert not apart


def _recorded(name: str) -> dict[str, Any]:
    chosen = {name: golden.runs(small=True)[name]}
    ((_, columns),) = golden.run_all(chosen)
    return {key: golden.entry(each) for key, each in columns.items()}


def test_the_small_set_is_recorded() -> None:
    assert golden.runs(small=True).keys() == KEPT.keys()


def test_a_difference_is_named_with_its_size() -> None:
    column = golden.np.array([0.0, 1.0, 2.0])
    before = {"run": {"x": golden.entry(column), "end": "laps"}}
    after = {"run": {"x": golden.entry(column + golden.np.array([0.0, 0.0, 1e-9])), "end": "laps"}}
    assert golden.compare(before, before) == []
    assert golden.compare(before, after) == ["run: 1 differ: x (1e-09)"]
    assert golden.close(before["run"]["x"], after["run"]["x"], 1e-7)
    assert not golden.close(before["run"]["x"], after["run"]["x"], 1e-12)


def test_what_is_in_one_record_alone_is_named() -> None:
    assert golden.compare({"a": {}}, {"b": {}}) == [
        "a: only in the old record",
        "b: only in the new record",
    ]


def test_a_run_that_fails_is_recorded_as_its_error() -> None:
    def fails() -> Any:
        raise ValueError("no road")

    ((name, columns),) = golden.run_all({"run": fails})
    assert (name, columns) == ("run", {"failure": ["ValueError: no road"]})
