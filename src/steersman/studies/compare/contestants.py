"""What is compared: each word of the command is a drive, a benchmark's rows, or a controller."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from steersman.bench.drive import Row
from steersman.bench.entrants import Entrant, entrant
from steersman.bench.journal import NAME as ROWS
from steersman.bench.journal import read_rows
from steersman.bench.suite import Suite
from steersman.config import build, read_yaml
from steersman.episode import Episode, is_episode, load_episode
from steersman.errors import ConfigError, DataError, suggestion

# Most of them: they are told apart by a letter each.
MOST = 26
_SHOWN = 4
_EPISODE, _PROGRESS, _POLICY, _TUNED = "episode.npz", "progress.csv", "policy.onnx", "tuned.yaml"


class Contestant(NamedTuple):
    """One side of a comparison; which of the fields are there depends on ``sort``."""

    name: str
    sort: str
    """``drive``, ``rows``, ``training`` or ``controller``."""
    source: str
    """The word, or the file, that it came from."""
    learned: bool = False
    """Whether a policy is part of it, as far as is known."""
    episode: Episode | None = None
    rows: tuple[Row, ...] = ()
    entrant: Entrant | None = None
    folder: FilePath | None = None


class Benchmark(NamedTuple):
    """What a benchmark's folder tells of its scenarios."""

    folder: FilePath
    suite: Suite
    seeds: tuple[int, ...]
    commits: tuple[str, ...]


def contestants(words: Sequence[str]) -> list[Contestant]:
    """All contestants, under names that differ.

    A word is ``[name=]`` and: the folder or ``.npz`` file of a drive; the folder of a training
    (its policy), of a tuning (the best controller) or of a benchmark (every controller in it, or
    those after a colon: ``runs/bench:lqr,pid``); else a controller as ``steersman bench`` takes it.

    Raises:
        ConfigError: a controller is unknown, there are fewer than two or too many.
        DataError: a file is missing or malformed, or a folder holds none of these.
    """
    found = [one for word in words for one in _contestants(word)]
    if len(found) < 2:  # noqa: PLR2004 - one is compared with another
        given = f"; given {words[0]}" if words else ""
        raise ConfigError(f"there are two needed to compare{given}")
    if len(found) > MOST:
        raise ConfigError(f"{len(found)} to compare; at most {MOST}")
    return _distinct(found)


def _contestants(word: str) -> list[Contestant]:
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
    if (folder / _PROGRESS).is_file():
        if not (folder / _POLICY).is_file():
            raise DataError(f"{folder}: a training that has exported no policy yet ({_POLICY})")
        return [_controller(folder, _POLICY, "training", name)]
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


def _name(file: FilePath) -> str:
    """A file's own name, or its folder's where every folder has a file of that name."""
    common = file.name in {_EPISODE, _POLICY, _TUNED}
    return file.resolve().parent.name if common else file.stem


def _from_rows(folder: FilePath, chosen: Sequence[str], name: str) -> list[Contestant]:
    """A contestant for each controller of a benchmark, those that were given in their order."""
    by_name: dict[str, dict[str, Row]] = {}
    for row in _rows(folder):
        by_name.setdefault(row["controller"], {})[row["scenario"]] = row  # the last counts
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
        learned = any(row.get("learned", False) for row in rows)
        source = f"{folder}:{each}"
        out.append(Contestant(name or each, "rows", source, learned, rows=rows, folder=folder))
    return out


def _rows(folder: FilePath) -> list[Row]:
    """The rows of a benchmark's controllers; of those of its last command, if that is known."""
    if not (folder / ROWS).is_file():
        raise DataError(f"{folder / ROWS}: no such file; expected the folder of a benchmark")
    rows = list(read_rows(folder).values())
    last = _json(folder / "results.json").get("controllers")
    kept = [row for row in rows if last is None or row["controller"] in last]
    if not kept:
        raise DataError(f"{folder / ROWS}: holds no runs")
    return kept


def benchmark(folder: FilePath) -> Benchmark:
    """The scenarios of a benchmark's folder.

    Raises:
        DataError: the folder lacks ``suite.yaml`` or ``results.json``, or they are malformed.
    """
    told = _json(folder / "results.json")
    if not told:
        raise DataError(f"{folder / 'results.json'}: no such file; finish the benchmark first")
    try:
        suite = build(Suite, read_yaml(folder / "suite.yaml"))
        seeds = tuple(int(seed) for seed in told["seeds"])
    except (ConfigError, KeyError, TypeError, ValueError) as error:
        raise DataError(f"{folder}: not a benchmark of this version ({error})") from None
    return Benchmark(folder, suite, seeds, tuple(map(str, told.get("made_by", ()))))


def _json(file: FilePath) -> dict[str, Any]:
    """A JSON object; empty if the file is missing."""
    if not file.is_file():
        return {}
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{file}: cannot be read as JSON ({error})") from None
    return found if isinstance(found, dict) else {}


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
