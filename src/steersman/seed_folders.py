"""Folders of a training or tuning with several seeds: ``seed_0``, ``seed_1`` and so on in one."""

from __future__ import annotations

from pathlib import Path as FilePath

from steersman.errors import DataError

_PREFIX = "seed_"


def seed_folder(folder: FilePath, seed: int) -> FilePath:
    """Where what was done with a seed is written."""
    return folder / f"{_PREFIX}{seed}"


def seeds_in(folder: FilePath) -> dict[int, FilePath]:
    """The folders of single seeds in ``folder``, in the order of the seeds; they may be empty."""
    found = {f.name.removeprefix(_PREFIX): f for f in folder.glob(f"{_PREFIX}*/")}
    numbers = {int(text): place for text, place in found.items() if text.isdecimal()}
    return dict(sorted(numbers.items()))


def refuse_seeds(folder: FilePath) -> None:
    """Refuse the folder of several seeds, where a single one would be mixed with them.

    Raises:
        DataError: ``folder`` holds folders of seeds.
    """
    if seeds := seeds_in(folder):
        names = ", ".join(map(str, seeds))
        raise DataError(
            f"{folder}: holds the seeds {names}; write seeds={','.join(map(str, seeds))}, or give"
            " another folder"
        )
