"""Controllers are tuned, measured and compared; vehicles are identified."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, cast

from steersman import files
from steersman.api.cars import Made
from steersman.api.driving import Folder, announce, workers_for
from steersman.commands import Notify, Word, configuration
from steersman.config import resolve
from steersman.errors import ConfigError, how_to_install
from steersman.given import as_text
from steersman.ranges import seed_list
from steersman.seed_folders import refuse_seeds, seed_folder

if TYPE_CHECKING:
    from steersman.studies.findings import FalsifyResult
    from steersman.studies.identify.identification import Identified
    from steersman.studies.trials import TuneResult
    from steersman.vehicles import Vehicle


def tune(
    *words: Word,
    out: Folder,
    seeds: Sequence[int] | str | None = None,
    progress: Callable[[int, float], None] | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> TuneResult:
    """Search a controller's gains on a suite of drives; ``result.controller`` is the best.

    ``sm.tune("lqr", vehicle="my_car.yaml", road="my_track.csv", trials=200, out="runs/tune")``. The
    same call goes on where an interrupted one stopped.

    Args:
        words: a controller or a YAML file, assignments, components, or a ``TuneConfig``.
        out: folder of the study: ``study.jsonl``, ``tuned.yaml``, ``result.json``,
            ``pareto.json``, ``pareto.svg`` and, with the extra ``report``, ``history.svg``,
            ``report.html``.
        seeds: seeds of the search, a list or ``"0..2"``: each has its study in ``seed_N`` of
            ``out``, and ``tuned.yaml`` is that of the median cost. None: the one of the settings.
        progress: called after each trial with the trials done and the least cost so far [m].
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        notify: called with a sentence about the server, about what the runs do not show, and about
            what was found at what price.
        settings: fields of a tuning (``steersman show tune``).

    Returns:
        What is written to ``result.json``; with several seeds, that of the median.

    Raises:
        ConfigError: a word or a value is wrong, or ``out`` holds another study.
        DataError: a file is missing or malformed.
    """
    from steersman.report.tuning import chosen_words, spent_words, write_tuning
    from steersman.studies.trials import TuneResult, TuningTrials
    from steersman.studies.tune import tune as run
    from steersman.studies.tune_seeds import tune_seeds
    from steersman.studies.unseen import warning

    tell = notify or (lambda _: None)
    chosen = configuration("tune", words, settings)
    engine, jobs = workers_for(chosen.plant, engine, jobs)
    announce(chosen.plant, tell, [] if chosen.vehicle is None else [chosen.vehicle])
    blind = warning(chosen.suite)
    if blind is not None:
        tell(f"warning: {blind}")
    folder = files.out_folder(str(out))
    if seeds is None:
        refuse_seeds(folder)
        folders, result = [folder], run(chosen, folder, progress, engine=engine, jobs=jobs)
    else:
        numbers = seed_list(seeds)
        folders = [seed_folder(folder, seed) for seed in numbers]
        result = tune_seeds(chosen, numbers, folder, progress, engine=engine, jobs=jobs)
    for each in folders:
        trials = TuningTrials.read(each / "pareto.json")
        if not write_tuning(TuneResult.read(each / "result.json"), trials, each):
            tell(f"no report.html: it needs {how_to_install('report')}")
        where = "" if each == folder else f"{each.name}: "
        tell(f"{where}{chosen_words(trials)}")
        tell(f"{where}{spent_words(trials)}")
    for sentence in result.widened:
        tell(sentence)
    return result


def falsify(
    *words: Word,
    out: Folder,
    progress: Callable[[int, int, str], None] | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> FalsifyResult:
    """Search for the mildest disturbance under which a controller leaves the road.

    ``sm.falsify("controller=lqr", path="figure_eight", out="runs/lqr")``. The same call goes on
    where an interrupted one stopped.

    Args:
        words: a controller or a YAML file, assignments, components, or a ``FalsifyConfig``.
        out: folder for ``drives.jsonl``, ``falsify.json`` and, if its extra is installed,
            ``report.html``.
        progress: called after each drive with the drives done, the most there may be, and in
            words the mildest failure so far.
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: drives at a time; None: one for each core.
        notify: called with a sentence about the server, and about what is left out.
        settings: fields of a search (``steersman show falsify``).

    Returns:
        What is written to ``falsify.json``.

    Raises:
        ConfigError: a word or a value is wrong, or ``out`` holds another search.
        DataError: a file is missing or malformed.
    """
    from steersman.report.falsification import write_falsification
    from steersman.studies.falsify import falsify as run

    chosen = configuration("falsify", words, settings, notify)
    engine, jobs = workers_for(chosen.plant, engine, jobs)
    announce(chosen.plant, notify, [chosen.vehicle], [Made(chosen.controller, words)])
    folder = files.out_folder(str(out))
    result = run(chosen, folder, progress, engine=engine, jobs=jobs)
    if not write_falsification(result, folder / "report.html") and notify is not None:
        notify(f"no report.html: it needs {how_to_install('report')}")
    return result


def identify(  # noqa: PLR0913 - the recording's options and where the fit runs
    log: Folder | Sequence[Folder],
    vehicle: str | Vehicle = "carla_model3",
    *,
    columns: str | None = None,
    holdout: float = 0.25,
    last: bool = False,
    lock: float | None = None,
    ahead: float = 0.0,
    out: Folder | None = None,
    notify: Notify | None = None,
    engine: str | None = None,
    jobs: int | None = None,
) -> Identified:
    """Fit a vehicle to a recording.

    Args:
        log: a CSV file, an MCAP file or ROS 2 bag, or the folder of a drive; several of one car.
        vehicle: the vehicle that the fit starts from: a word or a component.
        columns: ``SIGNAL=TITLE,...`` where the signals of a CSV file stand, or ``carla``.
        holdout: share of the recording that only judges the fit, 0 to 0.5.
        last: whether that is the recording's end, instead of blocks of 10 s all over it.
        lock: the angle of ``steer_angle`` at full lock [rad].
        ahead: distance of the centre of mass ahead of the recorded point [m] (MCAP).
        out: YAML file for the vehicle.
        notify: called with a sentence at each stage of the fit.
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: starts of the fit that are searched at a time; None: one for each core.

    Raises:
        ConfigError: there is no such vehicle or engine, or a value is not allowed.
        DataError: the recording is missing, too short or malformed, or a figure ends at its bound.
    """
    from steersman.engine.jobs import Workers
    from steersman.studies.identify.identification import identify as fit
    from steersman.studies.identify.recording import joined, read_log
    from steersman.studies.identify.result import write

    if lock is not None and not lock > 0.0:
        raise ConfigError(f"{lock:g} is not allowed; must be greater than 0 [rad]", ("--lock",))
    start = vehicle_of(vehicle)
    files = list(log) if isinstance(log, (list, tuple)) else [as_text(log)]
    logs = [read_log(FilePath(file), lock, ahead, columns) for file in files]
    tell, workers = notify or (lambda _: None), Workers(engine, jobs)
    found = fit(joined(logs), start, holdout, tell, workers, last=last)
    if out is not None:
        write(found, FilePath(out))
    return found


def vehicle_of(word: Any) -> Vehicle:
    """A vehicle by name, or from a file."""
    return cast("Vehicle", resolve("vehicle", word))
