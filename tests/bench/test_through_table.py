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
