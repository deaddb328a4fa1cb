"""Policies that act through a controller, and their peers, in one table.

    python benchmarks/through.py runs/standard runs/foreign --out results/through

Reads what ``steersman bench standard`` and ``steersman bench foreign`` wrote and drives nothing:
``table.md`` has errors, lost drives, regret and computing time, ``references.md`` the lateral RMS
error on TUM-CONTROL's references with the exact state and with each published noise. Controllers
that ``--classical`` names stand first, the others follow in the order of the record. With
``--over``, ``over.md`` compares them with one of them, scenario by scenario, in each
world, and ``seeds.md`` each seed of them on the suite.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from steersman.bench.apart import apart
from steersman.bench.foreign import WORLDS, world_of
from steersman.bench.results import BenchResult, BenchRow, ControllerSummary, IntervalEstimate
from steersman.bench.statistics import Clusters
from steersman.bench.suite import CLEAN
from steersman.errors import three_digits
from steersman.files import write_text
from steersman.report.tables import interval_text

REFERENCES = {"reftraj_monteblanco_edgar": "Monteblanco", "reftraj_lvms_edgar": "LVMS"}
# Lateral RMS error [mm] of the weights-varying MPC of Zarrouki et al., least and most of its 26
# Pareto-optimal sets, in the drives of 120 s that TUM-CONTROL publishes.
PUBLISHED = {"Monteblanco": "139 to 287", "LVMS": "202 to 372"}

DISTURBED = "suite `standard`, disturbed"


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


def rows_in(folder: str) -> list[dict]:
    """A benchmark's rows."""
    lines = (Path(folder) / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]


def by_world(standard: list[dict], foreign: list[dict], maps: Iterable[str]) -> dict[str, list]:
    """Rows within grip by where they were driven."""
    out = apart(BenchRow.model_validate(row) for row in standard)
    kept = [row for row in standard if row["scenario"] not in out]
    worlds = {
        "suite `standard`, clean": [row for row in kept if row["disturbance"] == CLEAN],
        DISTURBED: [row for row in kept if row["disturbance"] != CLEAN],
    }
    for title in WORLDS:
        worlds[title] = [row for row in foreign if world_of(row["path"], maps) == title]
    return {title: rows for title, rows in worlds.items() if rows}


def over(worlds: dict[str, list], base: str, names: list[str]) -> Iterable[list[str]]:
    """The base's typical error, the others' over it, in pairs, and what was lost, by world."""
    others = [name for name in names if name != base]
    yield ["", f"`{base}`, typical [mm]", *(f"`{name}` over it" for name in others)]
    for title, rows in worlds.items():
        of = {row["scenario"]: row for row in rows if row["controller"] == base}
        logs = [math.log(row["charged_rms_m"]) for row in of.values()]
        cells = [f"{three_digits(1e3 * math.exp(np.mean(logs)))}, {_lost(list(of.values()))}"]
        for name in others:
            own = [row for row in rows if row["controller"] == name]
            ratios = [row["charged_rms_m"] / of[row["scenario"]]["charged_rms_m"] for row in own]
            draws = Clusters([row["path"] for row in own], [row["replicate"] for row in own])
            logs = np.log(ratios)
            found = draws.interval(lambda mean, logs=logs: np.exp(mean(logs)))
            cells.append(f"{interval_text(IntervalEstimate.of(found))}, {_lost(own)}")
        yield [title, *cells]


def by_seed(rows: list[dict], base: str) -> Iterable[list[str]]:
    """Each seed's typical error over the base's, in pairs, lost drives and steering."""
    yield ["controller", "seed", "over it, typical", "ended early", "steering change, RMS [1/1000]"]
    of = {row["scenario"]: row["charged_rms_m"] for row in rows if row["controller"] == base}
    for name, seed in sorted({(row["controller"], row["replicate"]) for row in rows}):
        own = [row for row in rows if (row["controller"], row["replicate"]) == (name, seed)]
        logs = [math.log(row["charged_rms_m"] / of[row["scenario"]]) for row in own]
        steering = np.sqrt(np.mean([row["steer_change_rms"] ** 2 for row in own]))
        figures = three_digits(math.exp(np.mean(logs))), _lost(own), three_digits(1e3 * steering)
        yield [f"`{name}`", seed.removeprefix("seed "), *figures]


def _lost(rows: list[dict]) -> str:
    return f"{sum(not row['completed'] for row in rows)} of {len(rows)} lost"


def main() -> None:
    """Read both benchmarks and write both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("standard", help="folder of a benchmark on the suite standard")
    parser.add_argument("foreign", help="folder of a benchmark on foreign worlds, with rows.jsonl")
    parser.add_argument("--classical", default="", help="names that stand first, with commas")
    parser.add_argument("--over", help="name of the one that over.md compares the others with")
    parser.add_argument("--out", required=True)
    given = parser.parse_args()
    standard, foreign = (
        BenchResult.read(Path(one) / "results.json") for one in (given.standard, given.foreign)
    )
    away = foreign.summary.controllers
    known = [name for name in standard.summary.controllers if name in away]
    first = [name for name in given.classical.split(",") if name]
    names = [*first, *(name for name in known if name not in first)]
    out, rows = Path(given.out), rows_in(given.foreign)
    write_text(out / "table.md", table(whole(standard, foreign, names)))
    write_text(out / "references.md", table(references(rows, names)))
    if given.over:
        worlds = by_world(rows_in(given.standard), rows, foreign.maps)
        write_text(out / "over.md", table(over(worlds, given.over, names)))
        write_text(out / "seeds.md", table(by_seed(worlds[DISTURBED], given.over)))


if __name__ == "__main__":
    main()
