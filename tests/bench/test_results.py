"""Results are written from their models and read back; files of earlier versions load."""

from __future__ import annotations

import json
from pathlib import Path as FilePath

import pytest

from steersman.bench import drive as module
from steersman.bench import suites
from steersman.bench.drive import key, measure, row_version
from steersman.bench.entrants import entrants
from steersman.bench.results import BenchResult, BenchRow
from steersman.bench.summary import results
from steersman.errors import DataError
from steersman.metrics.base import Metric, metrics
from steersman.studies.compare.results import DriveCompareResult, ScenarioCompareResult

ROOT = FilePath(__file__).parents[2] / "results"
WHO = entrants(["pid"])
SCENARIO = suites.quick().scenarios((0,))[0]


def kept(file: FilePath) -> object:
    return json.loads(file.read_text(encoding="utf-8"))


BENCHMARKS = sorted(
    file.relative_to(ROOT).as_posix()
    for file in ROOT.rglob("*.json")
    if '"summary"' in (text := file.read_text(encoding="utf-8"))
    and {"suite", "summary"} <= set(json.loads(text))
)


def test_all_kept_benchmarks_are_found() -> None:
    assert {"bench/results.json", "bench/mpc_delay_null/results.json"} <= set(BENCHMARKS)


@pytest.mark.parametrize("name", BENCHMARKS)
def test_benchmarks_of_earlier_versions_load(name: str) -> None:
    file = ROOT / name
    found = BenchResult.read(file)
    assert {k: v for k, v in found.plain().items() if k in kept(file)}.keys() == kept(file).keys()  # type: ignore[attr-defined,operator]
    summary = kept(file)["summary"]  # type: ignore[index]
    for who, figures in summary["controllers"].items():
        assert found.summary.controllers[who].all.rms_m.plain() == figures["all"]["rms_m"]
        assert found.summary.controllers[who].failures == figures["failures"]


def test_comparisons_of_earlier_versions_load() -> None:
    scenarios = ScenarioCompareResult.read(ROOT / "compare" / "core.json")
    assert scenarios.comparisons[0].figures["rms_m"].ratio.value == pytest.approx(15.297, abs=1e-3)
    drives = DriveCompareResult.read(ROOT / "compare" / "monza.json")
    assert drives.comparisons[0].along is not None
    assert drives.comparisons[0].along.places == 5793
    assert BenchResult.read(ROOT / "faults" / "core.json").summary.scenarios == 315


def test_a_result_is_what_its_file_holds(tmp_path: FilePath) -> None:
    rows = [measure(SCENARIO, WHO[0], "k")]
    found = results("quick", suites.quick(), [0], rows, WHO)
    found.write(tmp_path / "r.json")
    assert BenchResult.read(tmp_path / "r.json") == found
    assert BenchRow.model_validate(json.loads(json.dumps(rows[0].plain()))) == rows[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "Invalid JSON"), ("{}", "suite: Field required"), (None, "cannot be read")],
)
def test_files_that_are_no_results_are_one_line(
    tmp_path: FilePath, text: str | None, message: str
) -> None:
    file = tmp_path / "results.json"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=message) as caught:
        BenchResult.read(file)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


def test_other_columns_are_another_version(monkeypatch: pytest.MonkeyPatch) -> None:
    """A metric more, or of another unit, makes rows that were driven before no longer fit."""
    before, config = row_version(), SCENARIO.run
    one = key("plan", config, WHO[0])
    assert row_version() == before
    known = metrics(benchmark=True)
    for changed in ({**known, "more": Metric}, dict(list(known.items())[1:])):
        monkeypatch.setattr(module, "metrics", lambda found=changed, **_: found)
        assert row_version() != before
        assert key("plan", config, WHO[0]) != one
