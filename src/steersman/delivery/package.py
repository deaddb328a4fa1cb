"""Writes the files of a delivery and checks them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.controllers.policy import load_network
from steersman.delivery.graph import exact, read_network
from steersman.delivery.parity import TOLERANCE, random_features, rounding
from steersman.delivery.source import Source, read_source
from steersman.errors import DataError
from steersman.files import replacing, write_text
from steersman.policy_file import read_policy

# Observations on which the written network is compared with its source.
CHECKED = 2000
Tell = Callable[[str], object]


def write_onnx(words: str, folder: FilePath, tell: Tell) -> Sequence[FilePath]:
    """The policy as ``NAME.onnx`` with its card ``NAME.json``, read back and compared.

    Raises:
        DataError: the source is no sound policy, or what was written does not answer like it.
    """
    source = read_source(words)
    file = folder / f"{source.name}.onnx"
    with replacing(file) as stream:
        stream.write(source.data)
    card = file.with_suffix(".json")
    write_text(card, source.card.model_dump_json(indent=1) + "\n")
    tell(compare(source, file))
    return file, card


def compare(source: Source, file: FilePath) -> str:
    """Says how well a written network agrees with its source.

    Raises:
        DataError: its answers are others, or further from the exact ones than rounding explains.
    """
    data, card = read_policy(file)
    network = read_network(source.data, str(source.file))
    seen = random_features(network.scale, CHECKED)
    given = _answers(source.data, str(source.file), seen)
    written = _answers(data, str(file), seen)
    if card.scale != source.card.scale or not np.array_equal(given, written):
        raise DataError(f"{file}: answers differently from {source.file}")
    away = abs(written - exact(network, seen)[:, 0])
    if not (away <= TOLERANCE + rounding(network, seen)).all():
        raise DataError(f"{file}: differs from float64 by {away.max():.1e}, more than it may")
    return (
        f"{CHECKED} observations: as {source.file} to the bit; "
        f"from float64 at most {away.max():.1e} of full action"
    )


def _answers(data: bytes, name: str, features: Any) -> Any:
    run = load_network(data, name, features.shape[1])
    return np.array([run(row[None, :]) for row in features])
