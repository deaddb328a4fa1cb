"""What a command wrote is read back."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman.api.driving import Folder
from steersman.config import build, read_yaml, resolve
from steersman.errors import DataError, SteersmanError, how_to_install
from steersman.files import read_json

if TYPE_CHECKING:
    from steersman.stored import StoredResult


_YAML = (".yaml", ".yml")
# What a folder of a command holds, in the order in which it is looked for.
_LOADED = (
    *("episode.npz", "results.json", "policy.onnx", "tuned.yaml", "falsify.json"),
    *("compare.json", "config.yaml"),
)


def load(file: Folder) -> Any:
    """What a command wrote: from its folder, or from one of its files.

    A drive gives its Episode, a policy or a tuning the controller, a YAML file the configuration
    or component in it, a benchmark, comparison, tuning or
    search its results, and any other JSON file its plain data.

    Raises:
        DataError: there is no such file, or nothing of that sort can be loaded.
        SteersmanError: an extra is not installed.
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
    if place.suffix == ".mcap":
        try:
            from steersman.logs.restore import read_episode

            return read_episode(place)
        except ModuleNotFoundError:
            raise SteersmanError(f"{place}: it needs {how_to_install('logs')}") from None
    if place.suffix == ".onnx":
        return resolve("controller", {"kind": "policy", "file": str(place)})
    if place.suffix == ".json":
        return _from_json(place)
    if place.suffix in _YAML:
        return _from_yaml(place)
    expected = ".npz, .mcap, .onnx, .json, .yaml, or a folder"
    raise DataError(f"{place}: cannot be loaded; expected {expected}")


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
