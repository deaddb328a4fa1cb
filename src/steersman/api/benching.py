"""Controllers are measured and compared over the same scenarios."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from os import PathLike
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman import files, tuned
from steersman.api.cars import Made
from steersman.api.compared import cars_driven, sorted_out, tell_cars
from steersman.api.driving import Folder, announce, workers_for
from steersman.command_table import build_for
from steersman.commands import Notify, configuration, split, suite_settings
from steersman.config import dump, lay_over, override
from steersman.errors import ConfigError, counted, how_to_install
from steersman.given import as_text
from steersman.ranges import seed_list
from steersman.words import named as named_word

if TYPE_CHECKING:
    from steersman.bench.maps import Map
    from steersman.bench.results import BenchResult
    from steersman.bench.suite import Suite
    from steersman.episode import Episode
    from steersman.studies.compare.contestants import Contestant
    from steersman.studies.compare.results import AnyComparison

Progress = Callable[[float, float], None]


def bench(  # noqa: PLR0913 - the options of the command
    *controllers: str,
    suite: str | Sequence[str] = "standard",
    seeds: Sequence[int] | str = (0,),
    maps: Folder | None = None,
    tracks: Folder | None = None,
    tum: Folder | None = None,
    logs: Folder | None = None,
    out: Folder | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> BenchResult:
    """Drive controllers through the scenarios of a suite; rows and summary.

    ``sm.bench("tuned/lqr", "mine=runs/pid/tuned.yaml", suite="quick")``

    Args:
        controllers: words, each also as ``name=word``, none: those of the package; and fields of
            the suite, ``plant.host=...``.
        suite: ``standard``, ``core``, ``standard_1``, ``core_1``, ``tuning``, ``quick``,
            ``faults``, ``maps``, ``foreign`` or a YAML file; or a list of such a word and settings
            ``key=value``.
        seeds: seeds of all draws, a list or ``"0..4"``.
        maps: folder of OpenDRIVE maps (``*.xodr``): seeded ways over each are added to the suite;
            the suite ``maps`` holds them alone.
        tracks: folder of race circuits (``*.csv``), for the suite ``foreign``.
        tum: folder of TUM-CONTROL's reference trajectories (``*.json``), likewise.
        logs: folder of recorded lines (``*.csv``), likewise.
        out: folder for ``rows.jsonl``, ``results.json``, ``suite.yaml`` and, if their extras are
            installed, ``results.parquet`` and ``report.html``. The rows are kept, so that the same
            call goes on after an interruption.
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        progress: called with the simulated seconds done and in all.
        notify: called with a sentence about the work that begins, and about what is left out.
        settings: fields of the suite, e.g. ``corridor``.

    Returns:
        What is written to ``results.json``.

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed, or ``out`` cannot be written.
    """
    from steersman.bench.entrants import entrants
    from steersman.bench.results import RESULTS
    from steersman.bench.runner import bench as run
    from steersman.bench.suites import write_suite
    from steersman.bench.summary import results

    tell = notify or (lambda _: None)
    named, chosen = suite_settings([as_text(word) for word in controllers])
    numbers = seed_list(seeds)
    name, assignments = split([suite] if isinstance(suite, str) else suite)
    name = name or "standard"
    given = zip(("tracks", "maps", "tum", "logs"), (tracks, maps, tum, logs), strict=True)
    found_in = {key: FilePath(place) for key, place in given if place is not None}
    plan, read = _plan(name, [*chosen.values(), *assignments], settings, found_in, tell)
    engine, jobs = workers_for(plan.plant, engine, jobs)
    found, sources = entrants(named), dict(named_word(word) for word in named or tuned.names())
    made = [Made(one.controller, [sources.get(one.name, "")]) for one in found]
    announce(plan.plant, tell, plan.vehicles.values(), made)
    scenarios = plan.scenarios(numbers)
    if not scenarios:
        raise ConfigError(f"plant={plan.plant.kind} can do none of its scenarios", ("suite",))
    with kept(out) as folder:
        if left_out := plan.left_out(numbers):
            what = f"{sum(left_out.values())} scenarios, left out: {', '.join(left_out)}"
            tell(f"plant={plan.plant.kind} cannot do {what}")
        tell(f"{counted(len(scenarios), 'scenario')} x {counted(len(found), 'controller')}")
        rows = run(scenarios, found, folder, engine=engine, jobs=jobs, progress=progress)
        outcome = results(name, plan, numbers, rows, found, read)
        outcome.write(folder / RESULTS)
        write_suite(plan, folder)
        for who, one in outcome.summary.controllers.items():
            if failed := one.failed_words(who):
                tell(failed)
        if out is not None:
            _write_extras(folder, outcome, rows, scenarios, found, tell)
    return outcome


def _plan(
    suite: str,
    assignments: Sequence[str],
    settings: dict[str, Any],
    folders: Mapping[str, FilePath],
    tell: Notify,
) -> tuple[Suite, list[Map]]:
    """The suite with its settings, and with the courses over the files in the folders."""
    from steersman.bench.foreign import over_files

    plan, read = over_files(suite, folders, tell)
    if not (settings or assignments):
        return plan, read
    tree: Any = dump(plan)
    for name, value in settings.items():
        tree = lay_over(tree, name, value)
    return build_for("bench", override(tree, assignments)), read


def _write_extras(
    folder: FilePath, outcome: BenchResult, rows: Any, scenarios: Any, found: Any, tell: Notify
) -> None:
    """The table and the page, each if its extra is installed."""
    from steersman.bench.parquet import write_table
    from steersman.bench.replay import class_cases, median_cases, worst_cases

    if write_table(rows, folder) is None:
        tell(f"no results.parquet: it needs {how_to_install('bench')}")
    if has_report(tell):
        from steersman.report.benchmark import write_benchmark

        tell("driving once more what the page replays")
        finders = (worst_cases, median_cases, class_cases)
        cases = [case for finder in finders for case in finder(rows, scenarios, found)]
        write_benchmark(outcome, cases, folder / "report.html")


def compare(
    *contestants: str | PathLike[str] | Episode,
    suite: str | None = None,
    seeds: Sequence[int] | str | None = None,
    out: Folder | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> AnyComparison:
    """Set drives, trainings, benchmarks or controllers side by side.

    ``sm.compare("tuned/lqr", "policy", "runs/agent", suite="quick")``;
    ``sm.compare("tuned/lqr", "pid", path="track.csv", laps=1)``

    Args:
        contestants: drives (``Episode``), their folders or ``.npz`` files; folders of trainings,
            tunings or benchmarks; controllers; each word also as ``name=word``. The others are set
            against the first. Also ``suite=...`` and settings of the suite; or settings of one
            drive (``path=...``), which controllers and policies then all drive.
        suite: what controllers drive, ``quick`` by default.
        seeds: seeds of the suite, a list or ``"0..4"``.
        out: folder for ``compare.json``, ``report.html`` if its extra is installed, and the rows
            that are driven now.
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        progress: called with the simulated seconds done and in all.
        notify: called with a sentence about the work that begins.
        settings: of the suite, or of one drive, as keywords: ``path="circle"``.

    Raises:
        ConfigError: a word is unknown, or the contestants have nothing in common.
        DataError: a file is missing or malformed, or ``out`` cannot be written.
    """
    from steersman.studies.compare.contestants import contestants as found_by
    from steersman.studies.compare.contestants import sort_of
    from steersman.studies.compare.drives import compare_drives
    from steersman.studies.compare.scenarios import compare_scenarios, of_drive, plan

    tell = notify or (lambda _: None)
    named, chosen = sorted_out(contestants, settings)
    if suite is not None:
        chosen["suite"] = f"suite={suite}"
    numbers = None if seeds is None else seed_list(seeds)
    found = found_by(named)
    taken = {one.folder.resolve() for one in found if one.folder is not None}
    if out is not None and FilePath(out).resolve() in taken:
        raise ConfigError(f"--out: {out} is one of those compared; give another folder")
    drive = _one_drive(found, chosen, numbers)
    several = drive is not None and any(one.replicates for one in found)
    if not several and (drive is not None or sort_of(found) == "drives"):
        if drive is None and (chosen or numbers is not None):
            what = next(iter(chosen.values()), "--seeds")
            raise ConfigError(
                f"{what}: drives are compared on what they drove; it goes with controllers"
            )
        tell_cars(found, cars_driven(found, drive), tell)
        with kept(out) as folder:
            over_drives, episodes = compare_drives(found, drive)
            _write(over_drives, folder, out, tell, episodes=episodes)
        return over_drives
    name = chosen.pop("suite", "").partition("=")[2].strip() or None
    over = of_drive(drive) if several else plan(found, name, [*chosen.values()], numbers)
    engine, jobs = workers_for(over.suite.plant, engine, jobs)
    drivers = sum(len(one.drivers) for one in found)
    if over.suite.plant.computed:
        tell_cars(found, [*over.suite.vehicles.values()], tell)
    with kept(out) as folder:
        if drivers:
            tell(f"{counted(len(over.scenarios), 'scenario')} x {counted(drivers, 'controller')}")
        result, cases = compare_scenarios(
            found, over, folder, engine=engine, jobs=jobs, progress=progress
        )
        _write(result, folder, out, tell, cases=cases)
    return result


def _one_drive(
    found: Sequence[Contestant], chosen: dict[str, str], seeds: Sequence[int] | None
) -> Any:
    """The drive that settings such as ``path=...`` describe; None without one.

    Raises:
        ConfigError: a contestant is no controller, or the settings of a suite are given too.
    """
    from steersman.bench.suite import Suite

    words = {name: name.partition(".")[0] for name in chosen}
    own = [name for name, field in words.items() if field not in {"suite", *Suite.model_fields}]
    if not own:
        return None
    first = chosen[own[0]]
    saved = next((one for one in found if not one.drivers), None)
    if saved is not None:
        raise ConfigError(f"{first}: {saved.source} is driven already; it goes with controllers")
    if "suite" in words.values() or seeds is not None:
        raise ConfigError(f"{first}: a suite has paths of its own; leave out suite and --seeds")
    return configuration("drive", [*chosen.values()])


def _write(
    outcome: AnyComparison, folder: FilePath, out: Folder | None, tell: Notify, **shown: Any
) -> None:
    """The result and its page, if there is a folder that stays."""
    if out is None:
        return
    outcome.write(folder / "compare.json")
    if has_report(tell):
        from steersman.report.comparison import write_comparison

        write_comparison(outcome, folder / "report.html", **shown)


def has_report(tell: Notify) -> bool:
    """Whether pages can be written; says what they need if not."""
    found = find_spec("jinja2") is not None
    if not found:
        tell(f"no report.html: it needs {how_to_install('report')}")
    return found


@contextmanager
def kept(out: Folder | None) -> Iterator[FilePath]:
    """The folder for what is computed; without a name one that is gone at the end."""
    if out is not None:
        yield files.out_folder(str(out))
        return
    with tempfile.TemporaryDirectory() as name:
        yield FilePath(name)
