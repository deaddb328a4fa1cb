"""The tables in README and docs, written anew from the records.

    python benchmarks/tables.py

A table stands under its record's mark, ``<!-- results/bench/results.json -->``. Its first
column says what it shows: all controllers, chosen ones by disturbance, or chosen ones by world.
Under the mark of a record that is text, ``<!-- results/export/table.md -->``, stands the table of
it that begins alike, and under that of ``results/carla/api.json`` its rows. Everything else of a
page is prose, which stays as it is.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from steersman.bench.foreign import WORLDS, world_of
from steersman.bench.results import BenchResult, IntervalEstimate, PooledErrors, Summary
from steersman.files import write_text

ROOT = Path(__file__).resolve().parents[1]
RECORD = "results/bench/results.json"
FOREIGN = "results/foreign/results.json"
# What can be known at best of noisy waypoints, by disturbance.
BOUNDS = "results/estimation/suite.json"
# A record's mark and the table under it.
MARKED = re.compile(rf"(<!-- (?:{RECORD}|{FOREIGN}) -->\n)((?:\|.*\n?)+)(?<!\n)")
COPIED = re.compile(r"(<!-- (results/\S+\.md) -->\n)((?:\|.*\n?)+)(?<!\n)")
PROGRAMS = re.compile(r"(<!-- (results/carla/api\.json) -->\n)((?:\|.*\n?)+)(?<!\n)")
PAGES = ("README.md", "docs/bench.md")
COPIES = (
    "docs/carla_standin.md",
    "docs/export.md",
    "docs/node.md",
    "docs/precision.md",
    "docs/reproduce.md",
    "docs/second_opinion.md",
)
FOUR_DIGITS = 1000.0


def three(value: float) -> str:
    """Three digits, never as a power of ten."""
    return f"{value:.0f}" if abs(value) >= FOUR_DIGITS else f"{value:.3g}"


def interval(found: IntervalEstimate | None, factor: float = 1.0) -> str:
    """A value and its interval, three digits each."""
    if found is None or found.value is None:
        return ""
    low, high = (factor * (end or 0.0) for end in (found.low, found.high))
    return f"{three(factor * found.value)} [{three(low)}, {three(high)}]"


def every_controller(summary: Summary) -> Iterator[list[str]]:
    """All controllers, in the order of the record."""
    best = summary.best_classical
    yield [
        "controller",
        "clean, RMS [mm]",
        "disturbed, RMS [mm]",
        "disturbed, typical [mm]",
        "ended early",
        "regret, median [mm]",
        "RMS steering change [1/1000]",
        "median",
        "step [us]",
        f"RMS over {best}'s",
        "typical ratio",
    ]
    for name, found in summary.controllers.items():
        label = f"**policy `{name}`**" if found.learned else f"`{name}`"
        seeds = f" ({found.replicates} seeds)" if found.replicates > 1 else ""
        figure = found.figures["steer_change_rms"].median
        ratio = found.ratio["all"] if found.ratio else None
        yield [
            label + seeds,
            interval(found.clean.rms_m if found.clean else None, 1e3),
            interval(found.disturbed.rms_m if found.disturbed else None, 1e3),
            interval(found.disturbed.typical_m if found.disturbed else None, 1e3),
            f"{found.failures} of {found.runs}",
            interval(found.regret.median_m if found.regret else None, 1e3),
            f"{1e3 * (found.steer_change_rms or 0.0):.1f}",
            f"{1e3 * (figure.value or 0.0):.3g}",
            f"{found.control_time_us_p50:.0f}",
            interval(ratio.rms if ratio else None),
            interval(ratio.typical if ratio else None),
        ]


def by_disturbance(summary: Summary, header: list[str]) -> Iterator[list[str]]:
    """The controllers of a table's header, disturbance by disturbance."""
    bounds = json.loads((ROOT / BOUNDS).read_text(encoding="utf-8"))["found"]
    yield header
    for disturbance, rows in summary.by["disturbance"].items():
        least = bounds.get(disturbance)
        bound = "" if least is None else three(least["bound_mm"])
        yield [disturbance, *(lost_and_rms(rows, cell, bound) for cell in header[1:])]


def lost_and_rms(rows: Mapping[str, PooledErrors], cell: str, bound: str) -> str:
    """A controller's error [mm] and lost drives, or the bound."""
    if cell == "bound":
        return bound
    one = rows[cell.strip("`")]
    return f"{three(1e3 * (one.rms_m.value or 0.0))}, {one.failures} of {one.runs}"


def by_world(own: Summary, header: list[str]) -> Iterator[list[str]]:
    """The controllers of a table's header in the project's own and in foreign worlds."""
    names = [cell.strip("`") for cell in header[1:]]
    foreign = BenchResult.read(ROOT / FOREIGN)
    yield header
    for title in ("clean", "disturbed"):
        parts = [getattr(own.controllers[name], title) for name in names]
        yield [f"suite `standard`, {title}", *(typical([part]) for part in parts)]
    driven = foreign.summary.by["path"]
    for title in WORLDS:
        chosen = [driven[course] for course in driven if world_of(course, foreign.maps) == title]
        if chosen:
            yield [title, *(typical([course[name] for course in chosen]) for name in names)]


def typical(parts: Iterable[PooledErrors]) -> str:
    """Geometric mean of the drives' RMS errors [mm], and how many were lost."""
    found = [part for part in parts if part.runs]
    runs = sum(part.runs for part in found)
    logs = sum(part.runs * math.log(part.typical_m.value) for part in found)
    return f"{three(1e3 * math.exp(logs / runs))}, {sum(p.failures for p in found)} of {runs}"


def markdown(rows: Iterator[list[str]]) -> str:
    """A table; the first column is text."""
    header, *body = rows
    rule = "|".join(["---", *["---:"] * (len(header) - 1)])
    return "\n".join([f"| {' | '.join(header)} |", f"|{rule}|", *map(line, body)])


def line(cells: list[str]) -> str:
    """A row of a table."""
    return f"| {' | '.join(cells)} |"


def written(text: str, summary: Summary) -> str:
    """A page with its tables written anew."""
    return MARKED.sub(lambda found: found[1] + table(found[2], summary), text)


def copied(text: str) -> str:
    """A page with the tables of text records as they stand there, and of CARLA's programs."""
    text = PROGRAMS.sub(lambda found: found[1] + of_programs(rows_of(found[2])), text)
    return COPIED.sub(lambda found: found[1] + its_table(found[2], found[3]), text)


def rows_of(record: str) -> list[dict[str, str]]:
    """The rows of a record."""
    found: list[dict[str, str]] = json.loads((ROOT / record).read_text(encoding="utf-8"))["rows"]
    return found


def of_programs(rows: list[dict[str, str]]) -> str:
    """The rows of ``carla_api.py``: programs in their order, their tests in a line each."""
    lines = ["| program | test, arguments | outcome | what it said |", "|---|---|---|---|"]
    for each in rows:
        what, said = each["what"] and f"`{each['what']}`", each["said"].replace("|", "/")
        lines.append(f"| `{each['program']}` | {what} | {each['outcome']} | {said} |")
    return "\n".join(lines)


def its_table(record: str, old: str) -> str:
    """The table of a record whose first column has the title of the old one's."""
    blocks = (ROOT / record).read_text(encoding="utf-8").split("\n\n")
    tables = {first_title(each): each.strip() for each in blocks if each.startswith("|")}
    return tables[first_title(old)]


def first_title(table: str) -> str:
    """Of a table's first column."""
    return table.split("|")[1].strip()


def table(old: str, summary: Summary) -> str:
    """What a table that stands there shows now."""
    header = [cell.strip() for cell in old.splitlines()[0].strip("|").split("|")]
    shown = {"disturbance": by_disturbance, "world": by_world}.get(header[0])
    return markdown(shown(summary, header) if shown else every_controller(summary))


def main() -> None:
    """Write every page."""
    summary = BenchResult.read(ROOT / RECORD).summary
    for page in (*PAGES, *COPIES):
        file = ROOT / page
        text = file.read_text(encoding="utf-8")
        new = written(text, summary) if page in PAGES else copied(text)
        write_text(file, new)
        print(f"{page}: {'written' if new != text else 'as it was'}", file=sys.stderr)  # noqa: T201


if __name__ == "__main__":
    main()
