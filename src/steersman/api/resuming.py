"""A training that goes on: what is not said in words is taken from its folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman.errors import ConfigError, DataError, near_file
from steersman.seed_folders import seed_folder, seeds_in


def resumed(
    folder: FilePath,
    words: Sequence[Any],
    seeds: list[int] | None,
    notify: Callable[[str], None] | None = None,
) -> tuple[list[Any], list[int] | None]:
    """The words and the seeds of what goes on in ``folder``.

    Words that name a configuration stay as they are; without any, it is the one that the folder
    has, and its seeds are those for which it has folders.

    Args:
        folder: what the user named for results.
        words: as the command takes them; assignments alone name no configuration.
        seeds: those that were asked for; None: not said.
        notify: called with a sentence about seeds that were not asked for by number.

    Raises:
        DataError: no configuration is named, and the folder has none.
        ConfigError: one seed is set, and the folder has several.
    """
    if any(not isinstance(word, str) or "=" not in word for word in words):
        return list(words), seeds
    own, there = folder / "config.yaml", seeds_in(folder)
    if seeds is None and own.is_file():
        return [str(own), *words], None
    wanted = list(there) if seeds is None else seeds
    places = [seed_folder(folder, seed) for seed in wanted] + list(there.values())
    kept = next((f for place in places if (f := place / "config.yaml").is_file()), None)
    if kept is None:
        near = near_file(str(folder), ())
        raise DataError(
            f"{folder}: holds no training to resume; {near or 'name a preset or a file to begin'}"
        )
    if seeds is None:
        names = ", ".join(map(str, wanted))
        one = next((word for word in words if word.partition("=")[0].strip() == "seed"), None)
        if one is not None:
            raise ConfigError(f"{folder} holds the seeds {names}; write seeds= for some of them")
        if notify is not None:
            notify(f"{folder}: going on with the seeds {names}")
    return [str(kept), *words], wanted
