"""Policies that act through a controller, and their peers, in one table.

    python benchmarks/through.py runs/standard runs/foreign --out results/through

Reads what ``steersman bench standard`` and ``steersman bench foreign`` wrote and drives nothing:
``table.md`` has errors, lost drives, regret and computing time, ``references.md`` the lateral RMS
error on TUM-CONTROL's references with the exact state and with each published noise. Controllers
that ``--classical`` names stand first, the others follow in the order of the record.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from steersman.bench.results import BenchResult, ControllerSummary
from steersman.bench.suite import CLEAN
from steersman.errors import three_digits
from steersman.files import write_text
from steersman.report.tables import interval_text

REFERENCES = {"reftraj_monteblanco_edgar": "Monteblanco", "reftraj_lvms_edgar": "LVMS"}
# Lateral RMS error [mm] of the weights-varying MPC of Zarrouki et al., least and most of its 26
# Pareto-optimal sets, in the drives of 120 s that TUM-CONTROL publishes.
PUBLISHED = {"Monteblanco": "139 to 287", "LVMS": "202 to 372"}


def table(rows: Iterable[list[str]]) -> str:
    """Rows as Markdown, the first as the head."""
    head, *body = rows
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, rule, *body))


def whole(standard: BenchResult, foreign: BenchResult, names: list[str]) -> Iterable[list[str]]:
    """A row for each controller."""
    yield [
        *("controller", "clean, RMS [mm]", "disturbed, RMS [mm]", "disturbed, typical [mm]"),
        *("ended early", "regret, median [mm]", "steering change, RMS [1/1000]", "step [us]"),
        *("foreign, RMS [mm]", "foreign, typical [mm]", "foreign, ended early"),
    ]

    def lost(one: ControllerSummary) -> str:
        return f"{one.failures} of {one.runs}"

    for name in names:
        home, away = (found.summary.controllers[name] for found in (standard, foreign))
        yield [
            f"`{name}`",
            *(interval_text(one, 1e3) for one in (home.clean.rms_m, home.disturbed.rms_m)),
            *(interval_text(home.disturbed.typical_m, 1e3), lost(home)),
            interval_text(home.regret.median_m if home.regret else None, 1e3),
            three_digits(1e3 * (home.steer_change_rms or 0.0)),
            three_digits(home.control_time_us_p50),
            *(interval_text(one, 1e3) for one in (away.all.rms_m, away.all.typical_m)),
            lost(away),
        ]


def references(rows: list[dict], names: list[str]) -> Iterable[list[str]]:
    """RMS error on the references [mm], the mean over seeds [least, most], and drives lost."""
    words = sorted({row["disturbance"] for row in rows if row["path"] in REFERENCES} - {CLEAN})
    columns = [(path, word) for path in REFERENCES for word in (CLEAN, *words)]
    yield [
        "controller",
        *(
            f"{REFERENCES[path]}, {'exact' if word == CLEAN else word.replace('_', ' ')}"
            for path, word in columns
        ),
    ]
    for name in names:
        yield [f"`{name}`", *(_cell(rows, name, *column) for column in columns)]
    published = [PUBLISHED[REFERENCES[path]] if word == CLEAN else "" for path, word in columns]
    yield ["weights-varying MPC, published", *published]


def _cell(rows: list[dict], name: str, path: str, word: str) -> str:
    found = [
        row
        for row in rows
        if (row["controller"], row["path"], row["disturbance"]) == (name, path, word)
    ]
    if not found:
        return ""
    errors = 1e3 * np.array([row["charged_rms_m"] for row in found])
    text = three_digits(errors.mean())
    if len(found) > 1:
        text += f" [{three_digits(errors.min())}, {three_digits(errors.max())}]"
    lost = sum(not row["completed"] for row in found)
    return f"{text}, {lost} of {len(found)} lost" if lost else text


def main() -> None:
    """Read both benchmarks and write both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("standard", help="folder of a benchmark on the suite standard")
    parser.add_argument("foreign", help="folder of a benchmark on foreign worlds, with rows.jsonl")
    parser.add_argument("--classical", default="", help="names that stand first, with commas")
    parser.add_argument("--out", required=True)
    given = parser.parse_args()
    standard, foreign = (
        BenchResult.read(Path(one) / "results.json") for one in (given.standard, given.foreign)
    )
    known = standard.summary.controllers
    first = [name for name in given.classical.split(",") if name]
    names = [*first, *(name for name in known if name not in first)]
    lines = (Path(given.foreign) / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    rows = [json.loads(line) for line in lines]
    out = Path(given.out)
    write_text(out / "table.md", table(whole(standard, foreign, names)))
    write_text(out / "references.md", table(references(rows, names)))


if __name__ == "__main__":
    main()
