"""Controllers compared over the same scenarios: rows of benchmarks, and what is driven now."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import NamedTuple

from steersman.bench import drive
from steersman.bench.apart import apart
from steersman.bench.disturbance import Disturbance
from steersman.bench.entrants import Entrant
from steersman.bench.pairs import FEW_PATHS, against
from steersman.bench.replay import ShownCase, class_cases, median_cases, worst_cases
from steersman.bench.results import BenchRow
from steersman.bench.runner import bench
from steersman.bench.suite import CLEAN, Course, Scenario, Suite
from steersman.bench.suites import suite as read_suite
from steersman.bench.summary import summarise_rows
from steersman.errors import ConfigError, counted
from steersman.provenance import provenance
from steersman.rollout import RunConfig
from steersman.studies.compare.contestants import Contestant, SavedBenchmark, benchmark
from steersman.studies.compare.replicates import FEW_RUNS, compare_replicates, median_run
from steersman.studies.compare.results import ScenarioCompareResult, records

QUICK, LARGER = "quick", "core"
_SHOWN = 3


class ComparedScenarios(NamedTuple):
    """The scenarios that all contestants drive, or drove."""

    words: str
    """Where the scenarios come from."""
    suite: Suite
    seeds: tuple[int, ...]
    scenarios: tuple[Scenario, ...]
    warnings: tuple[str, ...] = ()
    more: str = ""
    """Where there are more paths, as the end of a warning."""


def plan(
    found: Sequence[Contestant],
    suite: str | None,
    assignments: Sequence[str],
    seeds: Sequence[int] | None,
) -> ComparedScenarios:
    """The scenarios: those of the benchmark among the contestants, else of a suite.

    Of several benchmarks those that they have in common, by name and by content.

    Raises:
        ConfigError: suite or seeds are given although a benchmark decides them, the benchmarks
            have no scenario in common, or the suite is unknown.
        DataError: a benchmark's folder is incomplete.
    """
    folders = list(dict.fromkeys(one.folder for one in found if one.sort == "rows" and one.folder))
    if not folders:
        name, numbers = suite or QUICK, tuple(seeds or (0,))
        chosen = read_suite(name, assignments)
        scenarios, more = tuple(chosen.scenarios(numbers)), f"; suite={LARGER} has more"
        return ComparedScenarios(f"suite {name}", chosen, numbers, scenarios, more=more)
    if suite is not None or assignments or seeds is not None:
        raise ConfigError(
            f"the scenarios are those of {folders[0]}; leave out suite, its settings and --seeds"
        )
    return _common([benchmark(folder) for folder in folders])


def of_drive(config: RunConfig) -> ComparedScenarios:
    """One drive as the only scenario, which methods with several seeds drive with each of them."""
    course = Course(path=config.path, speeds={config.speed.kind: config.speed})
    suite = Suite(
        courses={config.path.kind: course},
        vehicles={config.vehicle.kind: config.vehicle},
        plant=config.plant,
    )
    names = (config.path.kind, config.speed.kind, CLEAN, config.vehicle.kind)
    only = Scenario(*names, config.seed, Disturbance(), config)
    return ComparedScenarios("one drive", suite, (config.seed,), (only,))


def _common(folders: Sequence[SavedBenchmark]) -> ComparedScenarios:
    first, *others = folders
    scenarios = first.suite.scenarios(first.result.seeds)
    warnings = []
    for other in others:
        theirs = {s.name: s for s in other.suite.scenarios(other.result.seeds)}
        same = [s for s in scenarios if s.name in theirs]
        alike = [s for s in same if drive.digest(s) == drive.digest(theirs[s.name])]
        if not alike:
            raise ConfigError(f"{first.folder} and {other.folder} have no scenario in common")
        left_out = max(len(scenarios), len(theirs)) - len(alike)
        if left_out:
            warnings.append(
                f"{left_out} scenarios of {first.folder} or {other.folder} are not in both,"
                f" or differ ({len(same) - len(alike)}); left out"
            )
        scenarios = alike
    if len({tuple(folder.result.made_by) for folder in folders}) > 1:
        warnings.append("the benchmarks were driven by different commits")
    words = " and ".join(str(folder.folder) for folder in folders)
    return ComparedScenarios(
        words, first.suite, tuple(first.result.seeds), tuple(scenarios), tuple(warnings)
    )


def compare_scenarios(
    found: Sequence[Contestant],
    over: ComparedScenarios,
    folder: FilePath,
    *,
    engine: str | None = None,
    jobs: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> tuple[ScenarioCompareResult, list[ShownCase]]:
    """Drive what is not yet driven, and set every contestant against the first.

    Args:
        found: the contestants.
        over: the scenarios.
        folder: keeps the rows that are driven now.
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        progress: called with (simulated seconds done, simulated seconds in all).

    Returns:
        The result; worst and median drives, if all contestants were driven now.

    Raises:
        ConfigError: a controller does not fit the suite, or two have no scenario in common.
        DataError: the folder cannot be read or written.
    """
    rows = _saved(found, over)
    drivers = [driver for one in found for driver in one.drivers]
    if drivers:
        for row in bench(
            over.scenarios, drivers, folder, engine=engine, jobs=jobs, progress=progress
        ):
            rows.setdefault(row.controller, []).append(row)
    out = apart(row for own in rows.values() for row in own)
    kept = {name: [r for r in own if r.scenario not in out] for name, own in rows.items()}
    runs = {one.name: _runs(one, kept) for one in found}
    several = any(len(own) > 1 for own in runs.values())
    replicates = compare_replicates(runs) if several else None
    chosen = {name: median_run(own) for name, own in runs.items()}
    rows = {name: _renamed(rows[run], name) for name, run in chosen.items()}
    warnings = [*over.warnings, *_missing(rows, over), *_beyond(out)]
    base, *others = found
    comparisons = []
    for other in others:
        one, two = (_renamed(runs[n][chosen[n]], n) for n in (base.name, other.name))
        pairs = against(one, two, other.name)
        if not pairs.scenarios:
            raise ConfigError(f"{base.source} and {other.source} drove no scenario in common")
        comparisons.append(pairs)
    fewest_runs = min((len(own) for own in runs.values() if len(own) > 1), default=FEW_RUNS)
    if fewest_runs < FEW_RUNS:
        warnings.append(f"only {fewest_runs} seeds: the intervals over seeds are rough")
    fewest = min(pairs.paths for pairs in comparisons)
    if fewest < FEW_PATHS:
        warnings.append(few_paths(fewest) + over.more)
    every = [row for one in found for row in rows[one.name]]
    result = ScenarioCompareResult(
        contestants=records(found),
        scenarios=over.words,
        seeds=list(over.seeds),
        summary=summarise_rows(every, found),
        comparisons=comparisons,
        replicates=replicates,
        warnings=warnings,
        **provenance(),
    )
    shown = [_shown(one, runs[one.name]) for one in found if one.drivers]
    if len(shown) < len(found):
        return result, []
    finders = (worst_cases, median_cases, class_cases)
    return result, [case for find in finders for case in find(every, over.scenarios, shown)]


def _runs(one: Contestant, rows: Mapping[str, list[BenchRow]]) -> dict[str, list[BenchRow]]:
    """The rows of each seed of a contestant, or of its only run."""
    return {name: rows[name] for name in [driver.name for driver in one.drivers] or [one.name]}


def _renamed(rows: Sequence[BenchRow], name: str) -> list[BenchRow]:
    return [row.model_copy(update={"controller": name}) for row in rows]


def _shown(one: Contestant, runs: Mapping[str, Sequence[BenchRow]]) -> Entrant:
    """What is replayed of a contestant: its run of median error, under the contestant's name."""
    chosen = median_run(runs)
    return next(d for d in one.drivers if d.name == chosen)._replace(name=one.name)


def _beyond(scenarios: set[str]) -> list[str]:
    """The sentence on scenarios that no comparison counts."""
    if not scenarios:
        return []
    return [
        f"left out of what is compared: {counted(len(scenarios), 'scenario')} beyond grip (path"
        " and speeds ask an axle for over 90 % of it)"
    ]


def few_paths(count: int) -> str:
    """The warning about intervals that rest on few roads."""
    if count == 1:
        return "all on one path: there are no intervals over paths"
    return f"only {count} independent paths: the intervals are rough"


def _saved(found: Sequence[Contestant], over: ComparedScenarios) -> dict[str, list[BenchRow]]:
    """Each contestant's rows of the planned scenarios, under its own name, in their order."""
    out: dict[str, list[BenchRow]] = {}
    for one in found:
        mine = {row.scenario: row for row in one.rows}
        if one.rows or one.entrant is not None:
            out[one.name] = _renamed(
                [mine[s.name] for s in over.scenarios if s.name in mine], one.name
            )
    return out


def _missing(rows: Mapping[str, Sequence[BenchRow]], over: ComparedScenarios) -> list[str]:
    short = [f"{name} {len(own)}" for name, own in rows.items() if len(own) < len(over.scenarios)]
    if not short:
        return []
    more = ", ..." if len(short) > _SHOWN else ""
    return [f"of {len(over.scenarios)} scenarios drove: {', '.join(short[:_SHOWN])}{more}"]
