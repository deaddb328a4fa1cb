"""Write the files of a delivery, check them, and try the C code with a compiler."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.delivery.c_text import identifier
from steersman.delivery.graph import TOLERANCE, exact, random_features, read_network, rounding
from steersman.delivery.source import Source, read_source
from steersman.errors import DataError, one_line
from steersman.files import replacing, write_text
from steersman.network_file import PolicyNetwork
from steersman.policy_file import read_policy, sha256

# Observations on which the written network is compared with its source.
CHECKED = 2000
COMPILERS = ("cc", "gcc", "clang")
_LONGEST = 120.0
Tell = Callable[[str], object]


def unsaid(sentence: str) -> None:
    """Say nothing."""


def write_onnx(words: str, folder: FilePath, tell: Tell) -> Sequence[FilePath]:
    """The policy as ``NAME.onnx`` with its card ``NAME.json``, read back and compared.

    Raises:
        DataError: the source is no valid policy, or the outputs of the written file differ.
    """
    source = read_source(words)
    file = folder / f"{identifier(source.name)}.onnx"
    with replacing(file) as stream:
        stream.write(source.data)
    card = file.with_suffix(".json")
    new = {"files": {file.name: sha256(source.data)}, "made_for": None}
    write_text(card, source.card.model_copy(update=new).model_dump_json(indent=1) + "\n")
    tell(proven((file, card), lambda: compare(source, file)))
    return file, card


def proven(files: Sequence[FilePath], proof: Callable[[], str]) -> str:
    """The sentence of a proof of written files; where it fails, none of them stays.

    Raises:
        DataError: it fails.
    """
    try:
        return proof()
    except BaseException:
        for each in files:
            each.unlink(missing_ok=True)
        raise


def compare(source: Source, file: FilePath) -> str:
    """A sentence on how well a written network agrees with its source.

    Raises:
        DataError: its outputs differ, or are further from the exact ones than rounding explains.
    """
    data, card = read_policy(file)
    try:
        network = read_network(source.data, str(source.file))
    except DataError:  # more than a chain of layers
        network = None
    scale = np.ones(len(card.scale), np.float32) if network is None else network.scale
    seen = random_features(scale, CHECKED)
    given = _outputs(source.data, str(source.file), seen, card.actions)
    written = _outputs(data, str(file), seen, card.actions)
    if card.scale != source.card.scale or not np.array_equal(given, written, equal_nan=True):
        raise DataError(f"{file}: its outputs differ from those of {source.file}")
    same = f"{CHECKED} observations: as {source.file} to the bit"
    if network is None:
        return same
    away = abs(written - exact(network, seen)).max(axis=1)
    if not (away <= TOLERANCE + rounding(network, seen)).all():
        raise DataError(f"{file}: differs from float64 by {away.max():.1e}, more than it may")
    return f"{same}; from float64 at most {away.max():.1e} of full action"


def _outputs(data: bytes, name: str, features: Any, actions: int) -> Any:
    run = PolicyNetwork(data, name, features.shape[1], actions)
    return np.array([run(row[None, :]) for row in features])


def try_out(source: FilePath) -> str:
    """A sentence on how the test vector of a C source went, or why it was not run.

    Raises:
        DataError: its outputs are not the expected ones.
    """
    compiler = next((found for found in map(shutil.which, COMPILERS) if found), None)
    folder, vector = source.parent, source.name.replace("steersman", "test", 1)
    by_hand = f"make -C {folder} test"
    if compiler is None:
        return f"not compiled: there is no C compiler here; where there is one: {by_hand}"
    with tempfile.TemporaryDirectory() as scratch:
        program = FilePath(scratch, "test")
        files = [str(each.resolve()) for each in (source, source.with_name(vector))]
        words = [compiler, "-std=c99", "-O1", "-o", str(program), *files, "-lm"]
        try:
            made = _run(words)
            if made.returncode != 0:
                why = one_line(made.stderr)[:160]
                return f"not compiled: {FilePath(compiler).name} says {why}; by hand: {by_hand}"
            said = _run([str(program)])
        except (OSError, subprocess.SubprocessError) as error:
            return f"not tried: {one_line(str(error))[:160]}; by hand: {by_hand}"
    if said.returncode != 0:
        why = f"{source.name}: its test vector fails: {one_line(said.stdout)[:160]}"
        if "float time;" in source.with_suffix(".h").read_text(encoding="ascii"):
            why += "; float may be too coarse for this controller: --precision mixed or double"
        raise DataError(why)
    return f"{one_line(said.stdout)} (again: {by_hand})"


def _run(words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=_LONGEST)
