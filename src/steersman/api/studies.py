"""Controllers are tuned, measured and compared; vehicles are identified."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, cast

from steersman.commands import Notify, Word, check_order, configuration, key
from steersman.config import build, dump, lay_over, override, resolve
from steersman.errors import ConfigError

if TYPE_CHECKING:
    from steersman.bench.results import BenchResult
    from steersman.controllers.base import ControllerComponent
    from steersman.studies.compare.results import DriveCompareResult, ScenarioCompareResult
    from steersman.studies.findings import FalsifyResult
    from steersman.studies.identify.identification import Identified
    from steersman.vehicles import Vehicle


_Folder = str | PathLike[str]


def tune(
    *words: Word,
    out: _Folder,
    progress: Callable[[int, float], None] | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    **settings: Any,
) -> ControllerComponent:
    """Search a controller's gains on a suite of drives; the best controller.

    ``sm.tune("controller=pid", suite="tuning", trials=200, out="runs/tune")``. The same call goes
    on where an interrupted one stopped.

    Args:
        words: a controller or a YAML file, assignments, components, or a ``TuneConfig``.
        out: folder of the study: ``study.jsonl``, ``tuned.yaml``, ``result.json``.
        progress: called after each trial with the trials done and the least cost so far [m].
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        settings: fields of a tuning (``steersman show tune``).

    Raises:
        ConfigError: a word or a value is wrong, or ``out`` holds another study.
        DataError: a file is missing or malformed.
    """
    from steersman.studies.tune import tune as run

    chosen = configuration("tune", words, settings)
    return run(chosen, FilePath(out), progress, engine=engine, jobs=jobs)


def falsify(
    *words: Word,
    out: _Folder,
    progress: Callable[[int, int, str], None] | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    **settings: Any,
) -> FalsifyResult:
    """Search for the mildest disturbance under which a controller leaves the road.

    ``sm.falsify("controller=lqr", path="figure_eight", out="runs/lqr")``. The same call goes on
    where an interrupted one stopped.

    Args:
        words: a controller or a YAML file, assignments, components, or a ``FalsifyConfig``.
        out: folder for ``drives.jsonl`` and ``falsify.json``.
        progress: called after each drive.
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        settings: fields of a search (``steersman show falsify``).

    Returns:
        What is written to ``falsify.json``.

    Raises:
        ConfigError: a word or a value is wrong, or ``out`` holds another search.
        DataError: a file is missing or malformed.
    """
    from steersman.studies.falsify import falsify as run

    chosen = configuration("falsify", words, settings)
    return run(chosen, FilePath(out), progress, engine=engine, jobs=jobs)


def bench(
    *controllers: str,
    suite: str = "standard",
    seeds: Sequence[int] = (0,),
    out: _Folder | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    progress: Callable[[float, float], None] | None = None,
    **settings: Any,
) -> BenchResult:
    """Drive controllers through the scenarios of a suite; rows and summary.

    ``sm.bench("tuned/lqr", "mine=runs/pid/tuned.yaml", suite="quick")``

    Args:
        controllers: words, each also as ``name=word``, none: those of the package; and fields of
            the suite, ``plant.host=...``.
        suite: ``standard``, ``core``, ``tuning``, ``quick``, ``faults``, or a YAML file.
        seeds: seeds of all draws.
        out: folder that keeps the rows, so that the same call goes on after an interruption.
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        progress: called with the simulated seconds done and in all.
        settings: fields of the suite, e.g. ``corridor``.

    Returns:
        What is written to ``results.json``.

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed.
    """
    from steersman.bench.entrants import entrants
    from steersman.bench.results import RESULTS
    from steersman.bench.runner import bench as run
    from steersman.bench.suites import suite as read_suite
    from steersman.bench.suites import write_suite
    from steersman.bench.summary import results

    named, assignments = suite_settings(controllers)
    chosen = read_suite(suite)
    if settings or assignments:
        tree: Any = dump(chosen)
        for key, value in settings.items():
            tree = lay_over(tree, key, value)
        chosen = build(type(chosen), override(tree, assignments.values()))
    found = entrants(named)
    with kept(out) as folder:
        rows = run(
            chosen.scenarios(seeds), found, folder, engine=engine, jobs=jobs, progress=progress
        )
        outcome = results(suite, chosen, seeds, rows, found)
        outcome.write(folder / RESULTS)
        write_suite(chosen, folder)
    return outcome


def compare(
    *contestants: str,
    suite: str | None = None,
    seeds: Sequence[int] | None = None,
    out: _Folder | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> DriveCompareResult | ScenarioCompareResult:
    """Set drives, trainings, benchmarks or controllers side by side.

    ``sm.compare("tuned/lqr", "policy", "runs/agent", suite="quick")``

    Args:
        contestants: folders or ``.npz`` files of drives; folders of trainings, tunings or
            benchmarks; controllers; each also as ``name=word``. The others are set against the
            first.
        suite: what controllers drive, ``quick`` by default.
        seeds: seeds of the suite.
        out: folder that keeps the rows that are driven now.
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        progress: called with the simulated seconds done and in all.

    Raises:
        ConfigError: a word is unknown, or the contestants have nothing in common.
        DataError: a file is missing or malformed.
    """
    from steersman.studies.compare.contestants import contestants as found_by
    from steersman.studies.compare.contestants import sort_of
    from steersman.studies.compare.drives import compare_drives
    from steersman.studies.compare.scenarios import compare_scenarios, plan

    found = found_by(contestants)
    sort = sort_of(found)
    if sort == "drives":
        if suite is not None or seeds is not None:
            raise ConfigError("drives are compared on what they drove; leave out suite and seeds")
        return compare_drives(found)[0]
    over = plan(found, suite, [], seeds)
    with kept(out) as folder:
        return compare_scenarios(found, over, folder, engine=engine, jobs=jobs, progress=progress)[
            0
        ]


@contextmanager
def kept(out: _Folder | None) -> Iterator[FilePath]:
    """The folder for what is computed; without a name one that is gone at the end."""
    if out is not None:
        yield FilePath(out)
        return
    with tempfile.TemporaryDirectory() as name:
        yield FilePath(name)


def identify(
    log: _Folder,
    vehicle: str | Vehicle = "carla_model3",
    *,
    holdout: float = 0.25,
    lock: float | None = None,
    ahead: float = 0.0,
    out: _Folder | None = None,
    notify: Notify | None = None,
) -> Identified:
    """Fit a vehicle to a recording.

    Args:
        log: a CSV file, an MCAP file or ROS 2 bag, or the folder of a drive.
        vehicle: the vehicle that the fit starts from: a word or a component.
        holdout: share of the recording that only judges the fit, 0 to 0.5.
        lock: the angle of ``steer_angle`` at full lock [rad].
        ahead: distance of the centre of mass ahead of the recorded point [m] (MCAP).
        out: YAML file for the vehicle.
        notify: called with a sentence at each stage of the fit.

    Raises:
        ConfigError: there is no such vehicle, or a value is not allowed.
        DataError: the recording is missing, too short or malformed.
    """
    from steersman.studies.identify.identification import identify as fit
    from steersman.studies.identify.recording import read_log
    from steersman.studies.identify.result import write

    if lock is not None and not lock > 0.0:
        raise ConfigError(f"{lock:g} is not allowed; must be greater than 0 [rad]", ("--lock",))
    start = vehicle_of(vehicle)
    found = fit(read_log(FilePath(log), lock, ahead), start, holdout, notify or (lambda _: None))
    if out is not None:
        write(found, FilePath(out))
    return found


def vehicle_of(word: Any) -> Vehicle:
    """A vehicle by name, or from a file."""
    return cast("Vehicle", resolve("vehicle", word))


def suite_settings(words: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """The words that name something to drive, and by their key those that set the suite.

    >>> suite_settings(["pid", "mine=tuned/lqr", "corridor=1"])
    (['pid', 'mine=tuned/lqr'], {'corridor': 'corridor=1'})

    Raises:
        ConfigError: a setting undoes another.
    """
    from steersman.bench.suite import Suite

    known = {"suite", *Suite.model_fields}
    found = [word for word in words if "=" in word and key(word).partition(".")[0] in known]
    check_order(found)
    named = [word for word in words if word not in found]
    return named, {key(word): word for word in found}
