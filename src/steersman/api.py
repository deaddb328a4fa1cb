"""The verbs of Steersman: what the command line does, as functions.

Each takes the words that its command takes: names of components, of files and of presets, and
assignments ``key.field=value``; and beside them keyword arguments, components and mappings.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, cast

from steersman.commands import Notify, Word, configuration
from steersman.config import Component, build, dump, read_yaml, resolve
from steersman.errors import ConfigError, DataError

if TYPE_CHECKING:
    from steersman.bench.results import BenchResult
    from steersman.controllers.base import ControllerComponent
    from steersman.episode import Episode
    from steersman.learning.imitation.imitate import ImitationResult
    from steersman.learning.progress import ImitationRow, TrainRow
    from steersman.learning.task import Judged
    from steersman.learning.train import TrainResult
    from steersman.rollout import Attempt
    from steersman.studies.compare.results import DriveCompareResult, ScenarioCompareResult
    from steersman.studies.findings import FalsifyResult
    from steersman.studies.identify.identification import Identified
    from steersman.vehicles import Vehicle

__all__ = [
    "attempt",
    "bench",
    "compare",
    "configure",
    "drive",
    "falsify",
    "identify",
    "imitate",
    "load",
    "make",
    "train",
    "tune",
]

_Folder = str | PathLike[str]
_YAML = (".yaml", ".yml")


def configure(command: str, *words: Word, notify: Notify | None = None, **settings: Any) -> Any:
    """The configuration of a command, checked and complete.

    >>> configure("drive", "path.radius=50", path="circle", laps=1).path.radius
    50.0

    Args:
        command: ``drive``, ``train``, ``imitate``, ``tune`` or ``falsify``.
        words: as the command takes them; also components and mappings of fields.
        notify: called with a sentence if something was changed to fit a plant with one car.
        settings: fields by name; a mapping is laid over the field's default.

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed.
    """
    return configuration(command, words, settings, notify)


def make(family: str, word: Any, **fields: Any) -> Component:
    """A component from a word: a kind, ``tuned/NAME``, a file; or from a mapping with ``kind``.

    >>> make("path", "circle", radius=30).radius
    30.0

    Raises:
        ConfigError: there is no such family or component, or a field is wrong.
    """
    tree: Any = word
    if fields:
        tree = {**(dump(word) or {} if isinstance(word, Component) else {"kind": word}), **fields}
    found = resolve(family, tree)
    assert found is not None
    return found


def drive(
    *words: Word,
    out: _Folder | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
    **settings: Any,
) -> Episode:
    """Drive one closed loop; the record of the drive.

    >>> episode = drive("controller=pid", path="circle", duration=2)
    >>> episode.end
    'duration'

    Args:
        words: a YAML file, names of components, assignments, components, or a ``RunConfig``.
        out: folder for ``episode.npz``, ``metrics.json`` and ``config.yaml``.
        overwrite: whether an earlier drive in ``out`` is replaced.
        progress: called now and then with the share of the drive that is done.
        settings: fields of a drive (``steersman show drive``).

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed, or ``out`` cannot be written.
        ControllerError: the controller failed.
        PlantError: the plant failed, or cannot be reached.
    """
    chosen = configuration("drive", words, settings)
    folder = None if out is None else drive_folder(FilePath(out), overwrite=overwrite)
    found = attempt(chosen, progress=progress)
    if folder is not None:
        write_drive(folder, chosen, found.episode)
    if found.error is not None:
        raise found.error
    return found.episode


def attempt(
    *words: Word, progress: Callable[[float], None] | None = None, **settings: Any
) -> Attempt:
    """Drive one closed loop; what came of it, as a value.

    >>> attempt("controller=pid", path="circle", duration=2).outcome
    'finished'

    Args:
        words: as of :func:`drive`.
        progress: called now and then with the share of the drive that is done.
        settings: fields of a drive.

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed.
        PlantError: the plant cannot be reached.
    """
    from steersman.rollout import attempt as run

    return run(configuration("drive", words, settings), progress)


def drive_folder(folder: FilePath, *, overwrite: bool) -> FilePath:
    """The folder for a drive, made if need be.

    Raises:
        DataError: it holds a drive that is not to be replaced, or something else.
    """
    from steersman.files import make_folder

    make_folder(folder)
    if (folder / "episode.npz").exists():
        if not overwrite:
            raise DataError(f"{folder}: holds a drive already; give another folder or --overwrite")
    elif (folder / "config.yaml").exists():
        raise DataError(f"{folder}: holds the configuration of something else; give another folder")
    return folder


def write_drive(folder: FilePath, config: Any, episode: Episode) -> None:
    """Write ``episode.npz``, ``metrics.json`` and ``config.yaml``.

    Raises:
        DataError: a file cannot be written.
    """
    from steersman.config import to_yaml
    from steersman.files import write_text

    episode.save(folder / "episode.npz")
    text = json.dumps(drive_metrics(episode), indent=2, allow_nan=False)
    write_text(folder / "metrics.json", text + "\n")
    write_text(folder / "config.yaml", to_yaml(config))


def drive_metrics(episode: Episode) -> dict[str, Any]:
    """All metrics of a drive, and the plant that it was driven on."""
    from steersman.metrics.base import summarise

    return {**summarise(episode), "plant": episode.meta["plant"]}


def train(
    *words: Word,
    out: _Folder,
    reward: Callable[[Judged], float] | None = None,
    overwrite: bool = False,
    resume: bool = False,
    progress: Callable[[TrainRow], None] | None = None,
    tick: Callable[[int], None] | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> TrainResult:
    """Train an agent while a controller demonstrates; ``result.policy`` is the policy's file.

    ``sm.train("demo", "agent.gamma=0.9", steps=100_000, out="runs/agent")``

    Args:
        words: a preset or a YAML file, assignments, components, or a ``TrainConfig``.
        out: folder for policy, record, checkpoints and logs.
        reward: a further term of the reward as a Python function of each judged step.
        overwrite: whether an earlier training in ``out`` is replaced.
        resume: go on from the last checkpoint in ``out``.
        progress: called at every validation with the new row of ``progress.csv``.
        tick: called about twice a second with the environment steps done.
        notify: called with a sentence where something is to be said.
        settings: fields of a training (``steersman show train``).

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed, or ``out`` holds a training already.
        TrainingDiverged: losses or values are no longer finite or plausible.
    """
    from steersman.learning.train import train as run

    chosen = configuration("train", words, settings, notify)
    if reward is not None:
        chosen = chosen.rewarded(reward)
    return run(
        chosen,
        FilePath(out),
        progress,
        tick=tick,
        notify=notify,
        overwrite=overwrite,
        resume=resume,
    )


def imitate(
    *words: Word,
    out: _Folder,
    overwrite: bool = False,
    resume: bool = False,
    progress: Callable[[ImitationRow], None] | None = None,
    tick: Callable[[float], None] | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> ImitationResult:
    """Fit a network to a controller's actions; ``result.policy`` is the policy's file.

    ``sm.imitate("precision", "problem.demonstration.controller=mpc_delay", out="runs/dagger")``

    Args:
        words: a training's preset or a YAML file, assignments, or an ``ImitationConfig``.
        out: folder for policy, record and logs.
        overwrite: whether an earlier training in ``out`` is replaced.
        resume: go on from the last round in ``out``.
        progress: called after every round with the new row of ``progress.csv``.
        tick: called now and then with the rounds done.
        notify: called with a sentence where something is to be said.
        settings: fields of an imitation (``steersman show imitate``).

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed, or ``out`` holds a training already.
        TrainingDiverged: the loss is no longer finite.
    """
    from steersman.learning.imitation.imitate import imitate as run

    chosen = configuration("imitate", words, settings, notify)
    return run(
        chosen,
        FilePath(out),
        progress,
        tick=tick,
        notify=notify,
        overwrite=overwrite,
        resume=resume,
    )


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
        controllers: words, each also as ``name=word``; none: those of the package.
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

    chosen = read_suite(suite)
    if settings:
        tree: Any = dump(chosen)
        for key, value in settings.items():
            tree[key] = value
        chosen = build(type(chosen), tree)
    found = entrants(controllers)
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
    return cast("Vehicle", make("vehicle", word))


# What a folder of a command holds, in the order in which it is looked for.
_LOADED = (
    *("episode.npz", "results.json", "policy.onnx", "tuned.yaml", "falsify.json"),
    *("compare.json", "config.yaml"),
)


def load(file: _Folder) -> Any:
    """What a command wrote: from its folder, or from one of its files.

    A drive gives its Episode, a policy or a tuning the controller, a YAML file the configuration
    or component in it, a benchmark, comparison or search its results.

    Raises:
        DataError: there is no such file, or nothing of that sort can be loaded.
        ConfigError: the configuration in it is not valid today.
    """
    place = FilePath(file)
    if place.is_dir():
        inside = next((place / name for name in _LOADED if (place / name).is_file()), None)
        if inside is None:
            raise DataError(f"{place}: holds nothing to load; expected one of {', '.join(_LOADED)}")
        place = inside
    if not place.exists():
        raise DataError(f"{place}: no such file")
    if place.suffix == ".npz":
        from steersman.episode import load_episode

        return load_episode(place)
    if place.suffix == ".onnx":
        return make("controller", "policy", file=str(place))
    if place.suffix == ".json":
        try:
            return json.loads(place.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise DataError(f"{place}: cannot be read as JSON ({error})") from None
    if place.suffix in _YAML:
        return _from_yaml(place)
    raise DataError(f"{place}: cannot be loaded; expected .npz, .onnx, .json, .yaml, or a folder")


def _from_yaml(file: FilePath) -> Any:
    from steersman.commands import COMMANDS, settings_of

    tree = read_yaml(file)
    if set(tree) == {"controller"}:  # a tuning's
        return resolve("controller", tree["controller"])
    for name, entry in COMMANDS.items():
        if entry.own is not None and entry.own in tree:
            return build(settings_of(name), tree)
    return build(settings_of("drive"), tree)
