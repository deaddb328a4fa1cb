"""Writes the files of a delivery and checks them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.controllers.policy import load_network
from steersman.delivery.c_source import Parts, header, parts, source_text
from steersman.delivery.c_text import identifier
from steersman.delivery.graph import exact, read_network
from steersman.delivery.parity import TOLERANCE, random_features, rounding
from steersman.delivery.source import Source, read_source
from steersman.delivery.vector import program_text, vector_text
from steersman.errors import DataError
from steersman.files import replacing, write_text
from steersman.policy_file import PolicyCard, read_policy, sha256

# Observations on which the written network is compared with its source.
CHECKED = 2000
Tell = Callable[[str], object]


def write_onnx(words: str, folder: FilePath, tell: Tell) -> Sequence[FilePath]:
    """The policy as ``NAME.onnx`` with its card ``NAME.json``, read back and compared.

    Raises:
        DataError: the source is no sound policy, or what was written does not answer like it.
    """
    source = read_source(words)
    file = folder / f"{identifier(source.name)}.onnx"
    card = _write(folder, file.stem, source.card, {file.name: source.data})
    tell(compare(source, file))
    return file, card


def write_c(words: str, folder: FilePath) -> Sequence[FilePath]:
    """The policy as C99: header, source, test vector with its program, Makefile, network, card.

    Raises:
        DataError: the source is no sound policy, or one that C text cannot be made of.
    """
    source = read_source(words)
    made = parts(source, read_network(source.data, str(source.file)))
    prefix, name = f"steersman_{made.name}", made.name
    texts = {
        f"{prefix}.c": source_text(made),
        f"{prefix}.h": header(made),
        f"test_{name}.c": program_text(made),
        f"vector_{name}.h": vector_text(made),
        "Makefile": files("steersman.delivery.templates").joinpath("Makefile.in").read_text(),
    }
    contents = {each: text.encode("ascii") for each, text in texts.items()}
    limits = {**source.card.limits, **_limits(made)}
    card = source.card.model_copy(update={"limits": limits})
    _write(folder, name, card, {**contents, f"{name}.onnx": source.data})
    read_policy(folder / f"{name}.onnx")
    return [folder / each for each in contents]


def _write(folder: FilePath, name: str, card: PolicyCard, contents: dict[str, bytes]) -> FilePath:
    """Write the files of a delivery, then the card with their digests."""
    for each, content in contents.items():
        with replacing(folder / each) as stream:
            stream.write(content)
    digests = {each: sha256(content) for each, content in contents.items()}
    file = folder / f"{name}.json"
    write_text(file, card.model_copy(update={"files": digests}).model_dump_json(indent=1) + "\n")
    return file


def _limits(made: Parts) -> dict[str, list[float]]:
    """What the C text bounds beside action and steering."""
    speed, shift = made.policy.trim_speed, made.policy.trim_limit
    out = {"path shift [m]": [-shift, shift], "its speed [m/s]": [-speed, speed]}
    if made.card.rate_limit is not None:
        out["steer rate [1/s]"] = [-made.card.rate_limit, made.card.rate_limit]
    return out


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
