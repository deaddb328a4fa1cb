"""What a command wrote is read back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman.api.driving import Folder
from steersman.config import build, read_yaml, resolve
from steersman.errors import DataError, SteersmanError, how_to_install
from steersman.files import read_json
from steersman.seed_folders import seeds_in

if TYPE_CHECKING:
    from steersman.stored import StoredResult


_RECORD = "progress.csv"
_YAML = (".yaml", ".yml")
# What a folder of a command holds, in the order in which it is looked for.
_LOADED = (
    *("episode.npz", "results.json", "policy.onnx", "tuned.yaml", "falsify.json"),
    *("compare.json", "config.yaml"),
)


def load(file: Folder) -> Any:
    """What a command wrote: from its folder, or from one of its files.

    A drive gives its Episode, a policy or a tuning the controller, a YAML file the configuration
    or component in it, a benchmark, comparison, tuning or search its results, and any other JSON
    file its plain data. The folder of a training with several seeds gives all of them, and
    ``progress.csv`` the training beside it.

    Raises:
        DataError: there is no such file, or nothing of that sort can be loaded.
        SteersmanError: an extra is not installed.
        ConfigError: the configuration in it is not valid today.
    """
    place = FilePath(file)
    if place.is_dir():
        if (seeds := seeds_in(place)) and all((f / _RECORD).is_file() for f in seeds.values()):
            from steersman.learning.seeds import load_seeds

            return load_seeds(place)
        inside = next((place / name for name in _LOADED if (place / name).is_file()), None)
        if inside is None:
            raise DataError(f"{place}: holds nothing to load; expected one of {', '.join(_LOADED)}")
        place = inside
    if not place.exists():
        raise DataError(f"{place}: no such file")
    reader = _READERS.get(place.suffix if place.name != _RECORD else _RECORD)
    if reader is None:
        expected = ".npz, .mcap, .onnx, .json, .yaml, progress.csv, or a folder"
        raise DataError(f"{place}: cannot be loaded; expected {expected}")
    return reader(place)


def _from_npz(file: FilePath) -> Any:
    from steersman.episode import load_episode

    return load_episode(file)


def _from_mcap(file: FilePath) -> Any:
    try:
        from steersman.logs.restore import read_episode

        return read_episode(file)
    except ModuleNotFoundError:
        raise SteersmanError(f"{file}: it needs {how_to_install('logs')}") from None


def _from_onnx(file: FilePath) -> Any:
    return resolve("controller", {"kind": "policy", "file": str(file)})


def _from_record(file: FilePath) -> Any:
    from steersman.learning.progress import load_training

    return load_training(file.parent)


def _from_json(file: FilePath) -> Any:
    data = read_json(file)
    result = _result(file.name, data)
    return data if result is None else result.read(file)


def _result(name: str, data: Any) -> type[StoredResult] | None:
    """The class of the results that a file of this name holds; None if it has none."""
    if name == "results.json":
        from steersman.bench.results import BenchResult

        return BenchResult
    if name == "falsify.json":
        from steersman.studies.findings import FalsifyResult

        return FalsifyResult
    if name == "result.json":
        from steersman.studies.trials import TuneResult

        return TuneResult
    if name == "search.json":
        from steersman.studies.search import SearchResult

        return SearchResult
    if name == "compare.json":
        from steersman.studies.compare import results

        drives = isinstance(data, dict) and data.get("sort") == "drives"
        return results.DriveCompareResult if drives else results.ScenarioCompareResult
    return None


def _from_yaml(file: FilePath) -> Any:
    from steersman.command_table import COMMANDS, settings_of

    tree = read_yaml(file)
    if set(tree) == {"controller"}:  # a tuning's
        return resolve("controller", tree["controller"])
    for name, entry in COMMANDS.items():
        if entry.own is not None and entry.own in tree:
            return build(settings_of(name), tree)
    return build(settings_of("drive"), tree)


# By the ending of a file, or by its name.
_READERS: dict[str, Callable[[FilePath], Any]] = {
    ".npz": _from_npz,
    ".mcap": _from_mcap,
    ".onnx": _from_onnx,
    ".json": _from_json,
    _RECORD: _from_record,
    **dict.fromkeys(_YAML, _from_yaml),
}
