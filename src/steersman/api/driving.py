"""A closed loop: its configuration, one drive, and the files of a drive."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, TypeAlias

from steersman.api.cars import Made, about_cars
from steersman.api.noted import before, noted
from steersman.commands import Notify, Word, configuration
from steersman.config import Component, dump, resolve
from steersman.errors import ConfigError, DataError

if TYPE_CHECKING:
    from steersman.episode import Episode
    from steersman.outcome import Attempt
    from steersman.plants.base import PlantComponent
    from steersman.rollout import RunConfig
    from steersman.vehicles import Vehicle


Folder: TypeAlias = str | PathLike[str]


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
    out: Folder | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
    **settings: Any,
) -> Episode:
    """Drive one closed loop; the record of the drive.

    What does not fit the car, and why it went wrong, is in ``episode.notes``.

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
        KeyboardInterrupt: Ctrl-C; what was driven until then is in ``out``.
    """
    from steersman.outcome import Interrupted
    from steersman.rollout import attempt as run

    chosen = configuration("drive", words, settings)
    folder = None if out is None else drive_folder(FilePath(out), overwrite=overwrite)
    try:
        found = run(chosen, progress)
    except Interrupted as stopped:
        if folder is not None:
            write_drive(folder, chosen, stopped.episode)
        raise
    episode = noted(chosen, words, found.episode)
    if folder is not None:
        write_drive(folder, chosen, episode)
    if found.error is not None:
        raise found.error
    return episode


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


def announce(
    plant: PlantComponent,
    notify: Notify | None,
    vehicles: Iterable[Vehicle] = (),
    made: Iterable[Made] = (),
) -> None:
    """Notify about the plant, unless it is the embedded simulator; a stand-in is named as such.

    And which figures the file of a vehicle leaves to another car, which no car has, and what was
    made for another car, where the plant drives these cars.

    Raises:
        PlantError: the server does not answer.
        DataError: the file of a car cannot be read any more.
    """
    if notify is None:
        return
    if not plant.embedded:
        notify(f"driven on: {plant.source()}")
    for line in about_cars(vehicles, made if plant.computed else ()):
        notify(line)


def announce_drive(config: RunConfig, words: Sequence[Word], notify: Notify | None) -> None:
    """Notify about the plant, repairs of the path's file, and what does not fit the car.

    ``words`` are those of the command, which name the file of the gains.

    Raises:
        PlantError: the server does not answer.
        DataError: the path's file cannot be used.
    """
    if notify is None:
        return
    announce(config.plant, notify)
    for note in before(config, words):
        notify(note)


def workers_for(
    plant: PlantComponent, engine: str | None, jobs: int | None
) -> tuple[str, int | None]:
    """The engine and the number of jobs at a time, which is 1 on a server with its one car.

    Raises:
        ConfigError: there is no such engine, or the plant cannot do it.
    """
    from steersman.engine.jobs import engine_name

    try:
        name = engine_name(engine)
    except ConfigError as error:
        raise ConfigError(error.what, ("--engine",)) from None
    if plant.computed:
        return name, jobs
    if engine not in {None, "local"}:
        raise ConfigError(f"{engine} is not allowed; plant={plant.kind}: local", ("--engine",))
    if jobs not in {None, 1}:
        raise ConfigError(f"{jobs} is not allowed; plant={plant.kind} has one car: 1", ("--jobs",))
    return "local", 1
