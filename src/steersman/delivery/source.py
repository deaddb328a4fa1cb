"""The policy that is to be delivered, from the user's word for it."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import NamedTuple

from steersman.controllers.card import card_base, card_layout
from steersman.errors import ConfigError, DataError
from steersman.network_file import PolicyNetwork
from steersman.policy_file import PolicyCard, locate, read_policy

# The name of every training's policy; the folder's name is used instead.
_ANY = "policy"


class Source(NamedTuple):
    """A policy that was read and checked."""

    name: str
    """Short name, as the user wrote it."""
    file: FilePath
    """The ONNX file."""
    data: bytes
    """Its content."""
    card: PolicyCard


def read_source(words: str) -> Source:
    """The policy of a training's folder, of the package, or of an ONNX file or its card.

    Raises:
        DataError: there is none, or it is damaged or contradicts itself.
    """
    file = _file(words)
    data, card = read_policy(file)
    try:
        card_layout(card)
        card_base(card)
    except (ConfigError, DataError) as error:
        raise DataError(f"{file}: card: {error}") from None
    PolicyNetwork(data, str(file), len(card.scale), card.actions)
    whole = file.resolve()
    name = whole.parent.name if whole.stem == _ANY else whole.stem
    return Source(name or _ANY, file, data, card)


def _file(words: str) -> FilePath:
    given = FilePath(words)
    if given.is_dir():
        file = given / f"{_ANY}.onnx"
        if not file.is_file():
            raise DataError(f"{words}: no policy.onnx in this folder; name a training's folder")
        return file
    if given.suffix == ".json":
        return given.with_suffix(".onnx")
    return locate(words)
