"""What is compared: each word of the command is a drive, a benchmark's rows, or a controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Literal, NamedTuple

from steersman.bench.entrants import Entrant, entrant, replicates
from steersman.bench.results import RESULTS, BenchResult, BenchRow
from steersman.bench.runner import ROWS, read_rows
from steersman.bench.suite import Suite
from steersman.config import build, read_yaml
from steersman.episode import Episode, is_episode, load_episode
from steersman.errors import ConfigError, DataError, suggestion

# Each has a letter of its own.
MOST = 26
_SHOWN = 4
_EPISODE, _PROGRESS, _POLICY, _TUNED = "episode.npz", "progress.csv", "policy.onnx", "tuned.yaml"


class Contestant(NamedTuple):
    """One side of a comparison; which of the fields are there depends on ``sort``."""

    name: str
    sort: str
    """``drive``, ``rows``, ``training``, ``seeds`` or ``controller``."""
    source: str
    """The word, or the file, that it came from."""
    learned: bool = False
    """Whether a policy is part of it, as far as is known."""
    episode: Episode | None = None
    rows: tuple[BenchRow, ...] = ()
    entrant: Entrant | None = None
    folder: FilePath | None = None
    replicates: tuple[Entrant, ...] = ()
    """The same training or tuning with each of several seeds."""

    @property
    def drivers(self) -> tuple[Entrant, ...]:
        """What is driven now, under names that differ; empty if it was driven before."""
        if self.entrant is not None:
            return (self.entrant._replace(name=self.name),)
        return tuple(one._replace(name=f"{self.name} {one.name}") for one in self.replicates)


class SavedBenchmark(NamedTuple):
    """The scenarios of a benchmark's folder, and what drove them."""

    folder: FilePath
    suite: Suite
    result: BenchResult


def contestants(words: Sequence[str | Episode]) -> list[Contestant]:
    """All contestants, under names that differ.

    A word is ``[name=]`` and: the folder or ``.npz`` file of a drive; the folder of a training
    (its policy), of a tuning (the best controller), of either with several seeds (``seed_0``,
    ``seed_1`` and so on in it) or of a benchmark (every controller in it, or
    those after a colon: ``runs/bench:lqr,pid``); else a controller as ``steersman bench`` takes it.
    A drive itself is called by what drove it.

    Raises:
        ConfigError: a controller is unknown, there are fewer than two or too many.
        DataError: a file is missing or malformed, or a folder holds none of these.
    """
    found = [one for word in words for one in _contestants(word)]
    if len(found) < 2:  # noqa: PLR2004 - one is compared with another
        given = [word if isinstance(word, str) else "one drive" for word in words[:1]]
        raise ConfigError("; given ".join(["two are needed to compare", *given]))
    if len(found) > MOST:
        raise ConfigError(f"{len(found)} to compare; at most {MOST}")
    return _distinct(found)


def _contestants(word: str | Episode) -> list[Contestant]:
    if isinstance(word, Episode):
        return [Contestant(_driver(word), "drive", "a drive in Python", episode=word)]
    name, sign, spec = word.partition("=")
    if not sign:
        name, spec = "", word
    name, spec = name.strip(), spec.strip()
    place, _, chosen = spec.rpartition(":")
    if place and FilePath(place).is_dir():
        return _from_rows(FilePath(place), [c for c in chosen.split(",") if c], name)
    file = FilePath(spec)
    if file.is_dir():
        return _from_folder(file, name)
    if file.suffix == ".npz":
        return [_drive(file, name or _name(file))]
    one = entrant(word)
    return [Contestant(one.name, "controller", spec, one.learned, entrant=one)]


def _from_folder(folder: FilePath, name: str) -> list[Contestant]:
    if (folder / _EPISODE).is_file():
        return [_drive(folder / _EPISODE, name or _name(folder / _EPISODE))]
    if (folder / ROWS).is_file():
        return _from_rows(folder, [], name)
    seeds = tuple(replicates(folder))
    if (folder / _PROGRESS).is_file():
        if not (folder / _POLICY).is_file():
            raise DataError(f"{folder}: a training that has exported no policy yet ({_POLICY})")
        return [_controller(folder, _POLICY, "training", name)]
    if seeds:
        learned = any(one.learned for one in seeds)
        one = Contestant(name or folder.resolve().name, "seeds", str(folder), learned)
        return [one._replace(folder=folder, replicates=seeds)]
    for file in (_TUNED, _POLICY):
        if (folder / file).is_file():
            return [_controller(folder, file, "controller", name)]
    raise DataError(f"{folder}: {_nothing(folder)}")


def _nothing(folder: FilePath) -> str:
    """What to name instead of a folder that holds nothing to compare itself."""
    own = {ROWS, _EPISODE, _POLICY}
    shown = sorted({str(f.parent if f.name in own else f) for f in _inside(folder)})
    if not shown:
        return f"holds nothing to compare; expected {_EPISODE}, {ROWS}, {_POLICY} or {_TUNED}"
    more = f" and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else ""
    return f"name one of those in it: {', '.join(shown[:_SHOWN])}{more}"


def _inside(folder: FilePath) -> list[FilePath]:
    try:
        found = [f for name in ("*.npz", ROWS, _POLICY) for f in folder.rglob(name)]
        return [f for f in found if f.suffix != ".npz" or is_episode(f)]
    except OSError as error:
        raise DataError(f"{folder}: cannot be read ({error.strerror})") from None


def _controller(folder: FilePath, file: str, sort: str, name: str) -> Contestant:
    one = entrant(f"{name or _name(folder / file)}={folder / file}")
    return Contestant(one.name, sort, str(folder), one.learned, entrant=one, folder=folder)


def _drive(file: FilePath, name: str) -> Contestant:
    return Contestant(name, "drive", str(file), episode=load_episode(file), folder=file.parent)


def _driver(episode: Episode) -> str:
    """The kind of what drove; ``drive`` where it is not recorded."""
    config = episode.meta.get("config")
    controller = config.get("controller") if isinstance(config, Mapping) else None
    found = controller.get("kind") if isinstance(controller, Mapping) else None
    return str(found or "drive")


def _name(file: FilePath) -> str:
    """A file's own name, or its folder's where every folder has a file of that name."""
    common = file.name in {_EPISODE, _POLICY, _TUNED}
    return file.resolve().parent.name if common else file.stem


def _from_rows(folder: FilePath, chosen: Sequence[str], name: str) -> list[Contestant]:
    """A contestant for each controller of a benchmark, those that were given in their order."""
    by_name: dict[str, dict[str, BenchRow]] = {}
    for row in _rows(folder):
        by_name.setdefault(row.controller, {})[row.scenario] = row  # the last counts
    for word in chosen:
        if word not in by_name:
            raise ConfigError(f"{folder}: no controller {word!r}{suggestion(word, by_name)}")
    names = list(chosen or by_name)
    if name and len(names) > 1:
        raise ConfigError(
            f"{name}={folder} names {len(names)} controllers; write {name}={folder}:{names[0]}"
        )
    out = []
    for each in names:
        rows = tuple(by_name[each].values())
        learned = any(row.learned for row in rows)
        source = f"{folder}:{each}"
        out.append(Contestant(name or each, "rows", source, learned, rows=rows, folder=folder))
    return out


def _rows(folder: FilePath) -> list[BenchRow]:
    """The rows of a benchmark's controllers; of those of its last command, if that is known."""
    if not (folder / ROWS).is_file():
        raise DataError(f"{folder / ROWS}: no such file; expected the folder of a benchmark")
    rows = list(read_rows(folder).values())
    if (folder / RESULTS).is_file():
        last = BenchResult.read(folder / RESULTS).controllers
        rows = [row for row in rows if row.controller in last]
    if not rows:
        raise DataError(f"{folder / ROWS}: holds no runs")
    return rows


def benchmark(folder: FilePath) -> SavedBenchmark:
    """The scenarios of a benchmark's folder.

    Raises:
        DataError: the folder lacks ``suite.yaml`` or ``results.json``, or they are malformed.
    """
    file = folder / RESULTS
    if not file.is_file():
        raise DataError(f"{file}: no such file; finish the benchmark first")
    result = BenchResult.read(file)
    try:
        return SavedBenchmark(folder, build(Suite, read_yaml(folder / "suite.yaml")), result)
    except ConfigError as error:
        raise DataError(f"{folder}: not a benchmark of this version ({error})") from None


def _distinct(found: Sequence[Contestant]) -> list[Contestant]:
    """Names that occur more than once with their source behind, or a number."""
    counts: dict[str, int] = {}
    for one in found:
        counts[one.name] = counts.get(one.name, 0) + 1
    seen: dict[str, int] = {}
    out = []
    for one in found:
        name = one.name
        if counts[name] > 1:
            where = one.folder.name if one.folder is not None else one.sort
            name = f"{name} ({where})"
        seen[name] = seen.get(name, 0) + 1
        out.append(one._replace(name=name if seen[name] == 1 else f"{name} ({seen[name]})"))
    return out


def sort_of(found: Sequence[Contestant]) -> Literal["drives", "scenarios"]:
    """``drives`` if there is a saved drive among them, else ``scenarios``.

    Raises:
        ConfigError: drives and benchmarks, which have nothing in common that could be paired.
    """
    by_sort = {one.sort: one for one in reversed(found)}
    if "drive" not in by_sort:
        return "scenarios"
    if "seeds" in by_sort:
        raise ConfigError(
            f"{by_sort['drive'].source} is one drive and {by_sort['seeds'].source} holds several"
            " seeds; name one of them, or compare over a suite"
        )
    if "rows" in by_sort:
        raise ConfigError(
            f"{by_sort['drive'].source} is one drive and {by_sort['rows'].source} the rows of a"
            " benchmark, which keeps no drives; compare drives with drives"
        )
    return "drives"
