"""From the words of a command line to plain data: a YAML file and assignments over it."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman import tuned
from steersman.cli.output import note
from steersman.errors import ConfigError, DataError, suggestion

if TYPE_CHECKING:
    from steersman.plants.base import PlantComponent
    from steersman.vehicles import Vehicle

HELP = "A YAML file, and settings over it; a setting of a part is written part.key=value."
_POLICY = "its policy drives with controller=policy controller.file={inside}policy.onnx"
# A field that only the configuration of this command has, and what to do with it elsewhere.
_OWN = {
    "train": ("agent", _POLICY),
    "imitate": ("fit", _POLICY),
    "tune": ("smoothness", "what it found is {inside}tuned.yaml"),
    "falsify": ("ranges", "'steersman falsify {file}' takes it"),
    "bench": ("courses", "'steersman bench {file}' takes it"),
}
METAVAR = "[CONFIG.yaml] [key=value ...]"


def split(words: Sequence[str]) -> tuple[str | None, list[str]]:
    """The name of a file or preset, if the first word without "=" is one, and assignments.

    Raises:
        ConfigError: there is a second word without "=", or an assignment undoes another.
    """
    names = [word for word in words if "=" not in word]
    if len(names) > 1:
        raise ConfigError(
            f"{names[1]!r} is neither key=value nor the first name ({names[0]!r} is);"
            " write key=value"
        )
    assignments = [word for word in words if "=" in word]
    _check_order(assignments)
    return (names[0] if names else None), assignments


def _check_order(assignments: Sequence[str]) -> None:
    """Refuse an assignment that would silently undo one before it."""
    seen: dict[str, str] = {}
    for text in assignments:
        key = text.partition("=")[0].strip()
        if key in seen:
            raise ConfigError(f"given twice: {seen[key]} and {text}", (key,))
        inner = next((other for other in seen if other.startswith(f"{key}.")), None)
        if inner is not None:
            raise ConfigError(f"{text} would undo {seen[inner]}; put {text} first", (key,))
        seen[key] = text


def read(words: Sequence[str], command: str | None = None) -> dict[str, Any]:
    """The file's content with the assignments laid over it.

    Args:
        words: of the command line.
        command: whose configuration is expected, if that of another can be told.

    Raises:
        DataError: the file is missing or no YAML, or another command's configuration.
        ConfigError: the words contradict each other.
    """
    from steersman.config import override, read_yaml

    name, assignments = split(words)
    if name is None:
        return override({}, assignments)
    tree = read_yaml(existing(name, "; settings are written key=value"))
    if command is not None:
        _check_command(name, tree, command)
    return override(tree, assignments)


def _check_command(name: str, tree: Mapping[str, Any], command: str) -> None:
    """Refuse the configuration of another command, and say what to do with it."""
    own = next((c for c, (field, _) in _OWN.items() if field in tree), command)
    if own != command:
        folder = FilePath(name).parent
        inside = "" if folder == FilePath() else f"{folder}/"
        what = _OWN[own][1].format(inside=inside, file=name)
        raise DataError(f"{name}: is the configuration of 'steersman {own}'; {what}")


def for_one_car(
    tree: dict[str, Any], plant: Any, assignments: Sequence[str], changes: Sequence[str]
) -> dict[str, Any]:
    """The tree made fit for a plant that has one car; a note says what was changed.

    Args:
        tree: plain data.
        plant: the plant in it, by name or by fields.
        assignments: those of the user, which stay.
        changes: assignments that make it fit.
    """
    from steersman.config import override

    given = {key(word) for word in assignments}
    changes = [change for change in changes if key(change) not in given]
    if changes:
        kind = plant.get("kind") if isinstance(plant, dict) else plant
        note(f"plant={kind} drives one car: {' '.join(changes)}")
    return override(tree, changes)


def tell_plant(plant: PlantComponent) -> None:
    """Say on whose server it is driven, if on one; a stand-in's numbers are never CARLA's.

    Raises:
        PlantError: the server does not answer.
    """
    if not plant.embedded:
        note(f"driven on: {plant.source()}")


def key(word: str) -> str:
    """What an assignment assigns to; empty for a name."""
    return word.partition("=")[0].strip() if "=" in word else ""


def existing(name: str, hint: str = "") -> FilePath:
    """A file that is there, or ``tuned/NAME`` of the package; ``hint`` ends the message if not.

    Raises:
        DataError: it is not.
    """
    file = FilePath(name)
    shipped = tuned.locate(name)
    if shipped is not None and not file.exists():
        return shipped
    if file.is_dir():
        raise DataError(f"{name}: is a folder, expected a file")
    if not file.exists():
        near = suggestion(name, tuned.names()) if name.startswith("tuned/") else ""
        raise DataError(f"{name}: no such file{near}{hint}")
    return file


def vehicle(name: str) -> Vehicle:
    """A vehicle by name, or from a file.

    Raises:
        ConfigError: there is none of that name, or the file is wrong.
    """
    from steersman.config import build, lookup
    from steersman.vehicles import Vehicle

    if name.endswith((".yaml", ".yml")):
        found = build(lookup("vehicle", "file"), {"file": name})
    else:
        found = build(lookup("vehicle", name), {})
    assert isinstance(found, Vehicle)
    return found


def out_folder(name: str) -> FilePath:
    """The folder for results, made if need be and proved to be writable before anything runs.

    Raises:
        DataError: it cannot be made or written.
    """
    from steersman.files import make_folder

    if not name.strip():
        raise DataError("--out: expected the name of a folder, given nothing")
    folder = FilePath(name)
    if folder.exists() and not folder.is_dir():
        raise DataError(f"{folder}: is a file, expected a folder")
    make_folder(folder)
    try:
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise DataError(f"{folder}: cannot be written ({error.strerror})") from None


def out_file(name: str, option: str = "--out") -> FilePath:
    """The file for a result, in a folder that is proved to be writable before anything runs.

    ``option`` is what the user gave the name with.

    Raises:
        DataError: it is a folder, or its folder cannot be written.
    """
    file = FilePath(name)
    if not name.strip() or file.is_dir():
        raise DataError(f"{option}: expected the name of a file, given {name!r}")
    out_folder(str(file.parent))
    return file
