"""From contestants to the result of a comparison, as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman.errors import ConfigError
from steersman.policy_file import locate, read_policy
from steersman.provenance import provenance
from steersman.studies.compare.contestants import Contestant

FORMAT = 1
_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
# What a policy's card tells of its training, by what it is called here.
_TRAINED = ("steps", "simulated_seconds")
_VALIDATED = ("mean_error", "rms_error", "failures", "steer_activity")


def sort_of(found: Sequence[Contestant]) -> str:
    """``drives`` if there is a saved drive among them, else ``scenarios``.

    Raises:
        ConfigError: drives and benchmarks, which have nothing in common that could be paired.
    """
    by_sort = {one.sort: one for one in reversed(found)}
    if "drive" not in by_sort:
        return "scenarios"
    if "rows" in by_sort:
        raise ConfigError(
            f"{by_sort['drive'].source} is one drive and {by_sort['rows'].source} the rows of a"
            " benchmark, which keeps no drives; compare drives with drives"
        )
    return "drives"


def result(sort: str, found: Sequence[Contestant], compared: Mapping[str, Any]) -> dict[str, Any]:
    """The result as plain data: who was compared, what was found, what made it."""
    kept = {key: value for key, value in compared.items() if key not in {"cases", "episodes"}}
    return {
        "format": FORMAT,
        "sort": sort,
        "contestants": [_told(one, _LETTERS[k]) for k, one in enumerate(found)],
        **kept,
        **provenance(),
    }


def _told(one: Contestant, letter: str) -> dict[str, Any]:
    out: dict[str, Any] = {"letter": letter, "name": one.name, "sort": one.sort}
    out |= {"source": one.source, "learned": one.learned}
    if one.entrant is not None:
        out["controller"] = one.entrant.shown
    if one.sort == "training" and one.folder is not None:
        out["training"] = training(one.folder / "policy.onnx")
    return out


def training(policy: FilePath) -> dict[str, float | None]:
    """What the card of a policy tells of its training: steps, simulated seconds, validation.

    Raises:
        DataError: the file or its card is missing or malformed.
    """
    told = read_policy(locate(str(policy)))[1].training
    validation = told.get("validation", {})
    return {
        **{name: told.get(name) for name in _TRAINED},
        **{f"validation_{name}": validation.get(name) for name in _VALIDATED},
    }
