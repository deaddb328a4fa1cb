"""The benchmark's tables in README and docs show what the record holds."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from steersman.bench.results import BenchResult, IntervalEstimate

from ..scripts import script
from .pages import PAGES

ROOT = Path(__file__).resolve().parents[2]
RECORD = "results/bench/results.json"
NUMBER = r"-?[\d.]+"
TABLES = script("benchmarks/tables.py")
NOTHING = IntervalEstimate(value=None)


def rows(page: str) -> list[dict[str, str]]:
    """The rows of the table under the record's mark, by their columns."""
    text = (ROOT / page).read_text(encoding="utf-8").partition(f"<!-- {RECORD} -->\n")[2]
    lines = text.split("\n\n", 1)[0].splitlines()
    titles, _, *body = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(titles, cells, strict=True)) for cells in body]


def shown(cell: str) -> list[float]:
    return [float(number) for number in re.findall(NUMBER, cell)]


def estimate(found: IntervalEstimate, factor: float = 1.0) -> list[float]:
    return [factor * (value or 0.0) for value in (found.value, found.low, found.high)]


@pytest.mark.parametrize("page", ["README.md", "docs/bench.md"])
def test_a_table_shows_what_the_record_holds(page: str) -> None:
    summary = BenchResult.read(ROOT / RECORD).summary
    found, table = summary.controllers, rows(page)
    names = [re.findall(r"`(.*?)`", row["controller"])[0] for row in table]
    assert names == list(found)
    for name, row in zip(names, table, strict=True):
        one = found[name]
        assert one.ratio is not None
        wanted = {
            "clean, RMS [mm]": estimate(one.clean.rms_m, 1e3),
            "disturbed, RMS [mm]": estimate(one.disturbed.rms_m, 1e3),
            "disturbed, typical [mm]": estimate(one.disturbed.typical_m or NOTHING, 1e3),
            "ended early": [float(one.failures), float(one.runs)],
            "regret, median [mm]": estimate(one.regret.median_m if one.regret else NOTHING, 1e3),
            "RMS steering change [1/1000]": [1e3 * (one.steer_change_rms or 0.0)],
            "step [us]": [one.control_time_us_p50],
            f"RMS over {summary.best_classical}'s": estimate(one.ratio["all"].rms),
            "typical ratio": estimate(one.ratio["all"].typical),
        }
        for title, values in wanted.items():
            # Three digits, or the tenths and units that the column has.
            assert shown(row[title]) == pytest.approx(values, rel=6e-3, abs=0.51 * unit(row[title]))


@pytest.mark.parametrize("page", TABLES.PAGES)
def test_the_command_writes_every_table_as_it_stands(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    summary = BenchResult.read(ROOT / RECORD).summary
    assert TABLES.MARKED.search(text)
    assert TABLES.written(text, summary) == text, "python benchmarks/tables.py"


@pytest.mark.parametrize("page", TABLES.COPIES)
def test_the_command_copies_every_table_as_it_stands(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert TABLES.COPIED.search(text) or TABLES.PROGRAMS.search(text)
    assert TABLES.copied(text) == text, "python benchmarks/tables.py"


def unit(cell: str) -> float:
    """The last decimal place of a cell's first number."""
    digits = re.findall(NUMBER, cell)[0].partition(".")[2]
    return float(10.0 ** -len(digits))


MARKED = [
    (page, record)
    for page in PAGES
    if page.name != "README.md"  # its table of the demo turns the record's
    for record in re.findall(r"<!-- (results/\S+\.md) -->", page.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize(("page", "record"), MARKED)
def test_a_table_of_text_is_that_of_its_record(page: Path, record: str) -> None:
    kept = (ROOT / record).read_text(encoding="utf-8").splitlines()
    table = page.read_text(encoding="utf-8").partition(f"<!-- {record} -->\n")[2].lstrip()
    lines = table.split("\n\n", 1)[0].splitlines()
    assert len(lines) > 2
    for line in lines[:1] + lines[2:]:
        assert line in kept, line
