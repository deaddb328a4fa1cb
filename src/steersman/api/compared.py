"""What a comparison is given in Python: words, drives, and settings as keywords."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from steersman import core_yaml
from steersman.commands import key, suite_settings
from steersman.config import dump
from steersman.errors import ConfigError, suggestion

if TYPE_CHECKING:
    from steersman.episode import Episode


def sorted_out(
    given: Sequence[Any], settings: Mapping[str, Any]
) -> tuple[list[str | Episode], dict[str, str]]:
    """What is compared, and by their key the settings as assignments.

    Raises:
        ConfigError: something is neither a word nor a drive, or a keyword is unknown.
    """
    from steersman.bench.suite import Suite
    from steersman.episode import Episode
    from steersman.rollout import RunConfig

    fields = {*RunConfig.model_fields} - {"controller"}
    known = {*Suite.model_fields, *fields}
    for name in settings:
        if name.partition(".")[0] not in known:
            raise ConfigError(f"unknown setting {name!r}{suggestion(name, known)}")
    every = [str(one) if isinstance(one, PathLike) else one for one in given]
    for one in every:
        if not isinstance(one, str | Episode):
            raise ConfigError(
                f"cannot compare an object of type {type(one).__name__}; allowed: words, folders"
                " and files as text, and drives (Episode)"
            )
    texts = [one for one in every if isinstance(one, str)]
    keys = {key(text) for text in texts if "=" in text}
    more = [_assignment(name, value) for name, value in settings.items() if name not in keys]
    words, chosen = suite_settings([*more, *texts], also=fields)
    return [one for one in every if not isinstance(one, str) or one in words], chosen


def _assignment(name: str, value: Any) -> str:
    """A keyword as the command line's word."""
    plain = dump(value) if isinstance(value, BaseModel) else value
    if isinstance(plain, PathLike):
        plain = str(plain)
    if isinstance(plain, str) and core_yaml.value(plain) == plain:
        return f"{name}={plain}"
    try:
        return f"{name}={json.dumps(plain)}"
    except (TypeError, ValueError):
        raise ConfigError(
            f"a value of type {type(value).__name__} is not allowed", (name,)
        ) from None
