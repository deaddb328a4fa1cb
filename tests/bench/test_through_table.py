"""benchmarks/through.py: two benchmarks as one table, references by seed and noise."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from steersman.bench.results import BenchResult

from ..scripts import ROOT, script

through = script("benchmarks/through.py")
RECORD = ROOT / "results" / "foreign" / "results.json"


def row(error: float, seed: str = "", *, word: str = "clean", lost: bool = False) -> dict:
    return {
        "controller": "agent",
        "path": "reftraj_lvms_edgar",
        "disturbance": word,
        "replicate": seed,
        "charged_rms_m": error,
        "completed": not lost,
    }


def cells(rows: list[dict]) -> dict[str, str]:
    head, found, _ = through.references(rows, ["agent"])
    return dict(zip(head, found, strict=True))


def test_a_reference_has_the_mean_over_seeds_the_extremes_and_what_was_lost() -> None:
    rows = [row(0.1, "0"), row(0.3, "1", lost=True), row(0.05, word="published_noise_1")]
    found = cells(rows)
    assert found["LVMS, exact"] == "200 [100, 300], 1 of 2 lost"
    assert found["LVMS, published noise 1"] == "50"
    assert found["Monteblanco, exact"] == ""


def test_the_published_errors_stand_beside_the_exact_state_alone() -> None:
    head, _, published = through.references([row(0.1), row(0.2, word="a_noise")], ["agent"])
    found = dict(zip(head, published, strict=True))
    assert found["LVMS, exact"] == "202 to 372"
    assert found["LVMS, a noise"] == ""


def test_ratios_are_those_of_the_same_drives_in_each_world_and_of_each_seed() -> None:
    """The base errs ten times as much on one road: pairs alone tell that the agent has half."""

    def drives(name: str, factor: float, seed: str = "", *, lost: bool = False) -> list[dict]:
        steered = {"controller": name, "replicate": seed, "steer_change_rms": 0.01}
        errors = {"a": 0.01, "b": 0.1}
        paths = {road: f"multibody_{road}" for road in errors}
        return [
            {
                **row(factor * errors[road], seed, lost=lost),
                **steered,
                "path": path,
                "scenario": road,
            }
            for road, path in paths.items()
        ]

    rows = [*drives("base", 1.0), *drives("agent", 0.5, "0"), *drives("agent", 0.5, "1", lost=True)]
    worlds = through.by_world([], rows, [])
    assert list(worlds) == ["multi-body BMW"]
    head, found = through.over(worlds, "base", ["base", "agent"])
    assert head[1:] == ["`base`, typical [mm]", "`agent` over it"]
    assert found[1:] == ["31.6, 0 of 2 lost", "0.5 [0.5, 0.5], 2 of 4 lost"]
    _, *seeds = through.by_seed(rows, "base")
    assert [each[1:] for each in seeds] == [
        ["0", "0.5", "0 of 2 lost", "10"],
        ["1", "0.5", "2 of 2 lost", "10"],
        ["", "1", "0 of 2 lost", "10"],
    ]


@pytest.mark.parametrize("first", [[], ["precision"]])
def test_the_table_shows_what_both_records_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: list[str]
) -> None:
    source = tmp_path / "bench"
    source.mkdir()
    (source / "results.json").write_text(RECORD.read_text(encoding="utf-8"), encoding="utf-8")
    (source / "rows.jsonl").write_text("", encoding="utf-8")
    words = [str(source), str(source), "--classical", ",".join(first), "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["through.py", *words])
    through.main()
    head, _, *body = (tmp_path / "table.md").read_text(encoding="utf-8").splitlines()
    names = [line.split("`")[1] for line in body]
    known = BenchResult.read(RECORD).summary.controllers
    assert names == [*first, *(name for name in known if name not in first)]
    columns = [cell.strip() for cell in head.strip("|").split("|")]
    for name, line in zip(names, body, strict=True):
        found = dict(zip(columns, [c.strip() for c in line.strip("|").split("|")], strict=True))
        one = known[name]
        assert found["foreign, ended early"] == f"{one.failures} of {one.runs}"
        assert float(found["foreign, RMS [mm]"].split()[0]) == pytest.approx(
            1e3 * (one.all.rms_m.value or 0.0), rel=5e-3
        )
