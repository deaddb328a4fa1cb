"""Drives compared place by place along the path that they have in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from steersman.bench.along import along_path, same_path
from steersman.bench.disturbance import Disturbance
from steersman.bench.drive import drive
from steersman.bench.pairs import FEW_PATHS
from steersman.bench.suite import CLEAN, Scenario
from steersman.config import build
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.metrics.base import summarise
from steersman.provenance import provenance
from steersman.rollout import RunConfig
from steersman.studies.compare.contestants import Contestant
from steersman.studies.compare.results import (
    DriveCompareResult,
    DriveComparison,
    FieldDifference,
    records,
)

# Parts of a run that decide what it was; who drove is what is compared.
_CONDITIONS = (
    *("path", "vehicle", "speed", "start", "duration", "laps", "corridor"),
    *("sensor", "plant", "nominal", "seed"),
)

# What is recorded beside a drive changes nothing in it.
_RECORDED = "plant.record"
ONE_PATH = "one path, one drive of each: intervals are over its places, not over other paths"


def compare_drives(
    found: Sequence[Contestant], over: RunConfig | None = None
) -> tuple[DriveCompareResult, dict[str, Episode]]:
    """Set every drive against the first; controllers drive ``over``, or what the first drive drove.

    Returns:
        The result, and the drives by name.

    Raises:
        ConfigError: a controller is to drive what the first drive does not record.
    """
    episodes = _episodes(found, over)
    base, *others = found
    comparisons, warnings = [], [ONE_PATH]
    for other in others:
        one, two = episodes[base.name], episodes[other.name]
        alike = same_path(one, two)
        along = along_path(one, two) if alike else None
        comparisons.append(
            DriveComparison(
                name=other.name,
                differ=differences(one.meta, two.meta),
                same_path=alike,
                along=along,
            )
        )
        if not alike:
            warnings.append(f"{base.name} and {other.name} drove different paths")
        elif along is None:
            warnings.append(f"{base.name} and {other.name} have hardly any of the path in common")
        elif along.blocks < FEW_PATHS:
            warnings.append(
                f"{other.name}: only {along.blocks} independent stretches: rough intervals"
            )
    warnings += [_unfinished(n, e) for n, e in episodes.items() if not e.completed]
    result = DriveCompareResult(
        contestants=records(found),
        metrics={name: summarise(episode) for name, episode in episodes.items()},
        comparisons=comparisons,
        warnings=warnings,
        **provenance(),
    )
    return result, episodes


def _unfinished(name: str, episode: Episode) -> str:
    """What a comparison over the stretch that both drove does not show."""
    end = episode.end.replace("_", " ")
    return (
        f"{name} ended early ({end} after {episode.distance:.0f} m); what follows is not compared"
    )


def _episodes(found: Sequence[Contestant], over: RunConfig | None) -> dict[str, Episode]:
    """The drives by name, those of the controllers driven now."""
    out = {}
    if over is None:
        over = _driven(next(one for one in found if one.episode is not None))
    scenario = Scenario("", "", CLEAN, "", over.seed, Disturbance(), over)
    for one in found:
        if one.episode is not None:
            out[one.name] = one.episode
        elif one.entrant is not None:
            out[one.name] = drive(scenario, one.entrant)
    return out


def _driven(pattern: Contestant) -> RunConfig:
    """What a saved drive drove."""
    assert pattern.episode is not None
    meta = pattern.episode.meta
    try:
        return build(RunConfig, meta["config"])
    except (ConfigError, KeyError, TypeError) as error:
        raise ConfigError(f"{pattern.source} does not record what was driven ({error})") from None


def differences(one: Mapping[str, Any], two: Mapping[str, Any]) -> list[FieldDifference]:
    """The settings in which what was driven differs, from the ``meta`` of two episodes."""
    pair = [_conditions(meta) for meta in (one, two)]
    names = dict.fromkeys(name for fields in pair for name in fields)
    return [
        FieldDifference(field=name, base=pair[0].get(name), own=pair[1].get(name))
        for name in names
        if pair[0].get(name) != pair[1].get(name)
    ]


def _conditions(meta: Mapping[str, Any]) -> dict[str, Any]:
    config = meta.get("config")
    tree = config if isinstance(config, Mapping) else {}
    fields = dict(_flat({name: tree[name] for name in _CONDITIONS if name in tree}))
    return {name: value for name, value in fields.items() if name != _RECORDED}


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
