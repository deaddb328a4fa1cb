"""Damaged files against every reader: an answer or one line, in bounded time and memory.

    python benchmarks/fuzz.py [--seconds 60] [--seed 0] [--only TARGET] [--out results/fuzz]

Each target has a small corpus of its own making. An input is one of its files with a few bytes,
words or stretches changed, doubled, cut or taken from another, by a seeded generator. What ends in
anything but an answer or a ``SteersmanError`` is a fault, and its input is kept in ``--out``.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import steersman as sm
from carla_standin import wire
from steersman.bench.results import BenchResult
from steersman.config import read_yaml, resolve
from steersman.episode import load_episode
from steersman.files import write_text
from steersman.learning import checkpoint, snapshot
from steersman.logs.restore import read_episode
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.xodr.check import faults
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.paths.xodr.write import opendrive
from steersman.policy_file import locate
from steersman.provenance import provenance
from steersman.report.runs import load_runs
from steersman.vehicles import CarlaModel3

SLOWEST, LARGEST = 10.0, 500.0
"""A reading that takes longer [s], or makes the process grow by more [MB], is a fault."""
_WORDS = (
    *(b"", b"0", b"-1", b"1e308", b"nan", b"9" * 400, b"null", b"[", b"{", b"&a", b"*a", b"\xff"),
)
_STEP = 0.05
MOST_BYTES = 2_000_000
_YAML = b"a: &a {b: 1}\nc: [*a, *a]\nd: {<<: *a}\n"


class Target(NamedTuple):
    """A reader, and files that it reads."""

    suffix: str
    corpus: list[bytes]
    read: Callable[[Path], object]


def main() -> None:
    """Fuzz each target for a while and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="time for each target [s]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="one target alone")
    parser.add_argument("--out", type=Path, default=Path("results/fuzz"))
    words = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for name, target in targets(place).items():
            if words.only in {None, name}:
                rows.append(fuzz(name, target, place, words.seconds, words.seed, words.out))
                sys.stdout.write(json.dumps(rows[-1]) + "\n")
                sys.stdout.flush()
    made = {"seconds": words.seconds, "seed": words.seed, **provenance()}
    write_text(words.out / "table.json", json.dumps({"made": made, "rows": rows}, indent=1) + "\n")
    raise SystemExit(any(row["faults"] for row in rows))


def fuzz(
    name: str, target: Target, place: Path, seconds: float, seed: int, out: Path
) -> dict[str, object]:
    """One row of the table."""
    rng = np.random.default_rng(seed)
    file = place / f"input{target.suffix}"
    for data in target.corpus:  # what is whole is read
        file.write_bytes(data)
        target.read(file)
    begun, inputs, answered, slowest = time.perf_counter(), 0, 0, 0.0
    found: dict[str, bytes] = {}
    before = memory()
    while time.perf_counter() - begun < seconds:
        data = damaged(target.corpus, rng)
        file.write_bytes(data)
        start, fault = time.perf_counter(), ""
        try:
            target.read(file)
            answered += 1
        except sm.SteersmanError as error:
            fault = "more than a line" if "\n" in str(error) else ""
        except Exception as error:  # noqa: BLE001 - whatever comes is what is looked for
            last = traceback.extract_tb(error.__traceback__)[-1]
            fault = f"{type(error).__name__} in {Path(last.filename).name}:{last.name}"
        took = time.perf_counter() - start
        if took > SLOWEST:
            fault = f"{fault} took too long".strip()
        if memory() - before > LARGEST:
            fault, before = f"{fault} took too much memory".strip(), memory()
        if fault:
            found.setdefault(fault, data)
        slowest, inputs = max(slowest, took), inputs + 1
    for k, data in enumerate(found.values()):
        sm_file = out / f"{name}_{k}{target.suffix}"
        sm_file.parent.mkdir(parents=True, exist_ok=True)
        sm_file.write_bytes(data)
    return {
        "target": name,
        "inputs": inputs,
        "answered": answered,
        "slowest_s": round(slowest, 3),
        "grown_mb": round(memory() - before, 1),
        "faults": sorted(found),
    }


def memory() -> float:
    """Most memory that the process has had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def damaged(corpus: list[bytes], rng: np.random.Generator) -> bytes:
    """A file of the corpus with one to four changes."""
    data = corpus[int(rng.integers(len(corpus)))]
    for _ in range(int(rng.integers(1, 5))):
        at, size = int(rng.integers(len(data) + 1)), int(2.0 ** rng.uniform(0.0, 10.0))
        change = _CHANGES[int(rng.integers(len(_CHANGES)))]
        data = data[:at] + change(data[at : at + size], corpus, rng) + data[at + size :]
    return data[:MOST_BYTES]


def _bytes(part: bytes, _: list[bytes], rng: np.random.Generator) -> bytes:
    few = min(len(part), 8)
    return rng.bytes(few) + part[few:]


def _repeated(part: bytes, _: list[bytes], rng: np.random.Generator) -> bytes:
    return part * int(2.0 ** rng.uniform(1.0, 8.0))


def _word(part: bytes, _: list[bytes], rng: np.random.Generator) -> bytes:
    word = _WORDS[int(rng.integers(len(_WORDS)))]
    return re.sub(rb"[\w.+-]+", lambda _: word, part, count=1)


def _other(part: bytes, corpus: list[bytes], rng: np.random.Generator) -> bytes:
    other = corpus[int(rng.integers(len(corpus)))]
    start = int(rng.integers(len(other) + 1))
    return other[start : start + len(part)]


_CHANGES = (_bytes, _repeated, _word, _word, _other, lambda *_: b"")


def targets(place: Path) -> dict[str, Target]:
    """Every reader with its corpus."""
    episode = sm.drive("pid", path="circle", duration=1.0)
    episode.save(place / "a.npz")
    with (place / "state.npz").open("wb") as stream:
        snapshot.write({"format": 2, "a": np.arange(9.0), "b": {"c": [1, "x", None]}}, stream)
    circle = resolve("path", "circle")
    rows = "".join(f"{3.0 * k},{0.1 * k * k}\n" for k in range(20))
    config = json.dumps(dict(episode.meta["config"]))
    card, network = (locate("precision").with_suffix(end) for end in (".json", ".onnx"))
    shipped = Path("results/bench/results.json")
    found = {
        "yaml": Target(
            ".yaml", [config.encode(), b"a: &a {b: 1}\nc: [*a, *a]\nd: {<<: *a}\n"], read_yaml
        ),
        "csv": Target(".csv", [f"x,y\n{rows}".encode(), rows.encode()], _csv),
        "opendrive": Target(".xodr", [opendrive(circle, "circle").encode()], _xodr),
        "episode": Target(".npz", [(place / "a.npz").read_bytes()], load_episode),
        "checkpoint": Target(".npz", [(place / "state.npz").read_bytes()], _checkpoint),
        "card": Target(".json", [card.read_bytes()], lambda f: _policy(f, network, card=True)),
        "network": Target(".onnx", [network.read_bytes()], lambda f: _policy(f, card, card=False)),
        "metrics": Target(".json", [b'{"a": 1.5, "b": [1, {"c": null}]}'], _metrics),
        "wire": Target(".bin", [_request(), _request("apply_batch", [[1, [2, None]]] * 3)], _wire),
    }
    if shipped.is_file():
        found["results"] = Target(".json", [shipped.read_bytes()[:400_000]], BenchResult.read)
    try:
        from steersman.logs.write import write_episode
    except ImportError:
        return found
    write_episode(place / "a.mcap", episode, CarlaModel3().table)
    found["recording"] = Target(".mcap", [(place / "a.mcap").read_bytes()], read_episode)
    return found


def _csv(file: Path) -> object:
    return resolve("path", {"kind": "csv", "file": str(file)}).length


def _xodr(file: Path) -> object:
    ways = Ways(read_network(file))
    found = faults(ways)
    for name in list(ways.network.roads)[:2]:
        _ = OpenDrivePath(file=file, road=name).table
    return found


def _checkpoint(file: Path) -> object:
    folder = file.parent / "training"
    (folder / checkpoint.FOLDER).mkdir(parents=True, exist_ok=True)
    (folder / checkpoint.FOLDER / "step_000000001.npz").write_bytes(file.read_bytes())
    with file.open("rb") as stream:
        snapshot.read(stream)
    return checkpoint.load(folder)


def _policy(file: Path, other: Path, *, card: bool) -> object:
    """The damaged half of a policy beside the whole one, whose digest is not asked for."""
    from steersman.network_file import PolicyNetwork

    if not card:
        features = len(json.loads(other.read_text())["scale"])
        return PolicyNetwork(file.read_bytes(), file.name, features)
    file.with_suffix(".onnx").write_bytes(other.read_bytes())
    return resolve("controller", {"kind": "policy", "file": str(file.with_suffix(".onnx"))}).init(
        CarlaModel3(), _STEP
    )


def _metrics(file: Path) -> object:
    folder = file.parent / "run"
    folder.mkdir(exist_ok=True)
    (folder / "metrics.json").write_bytes(file.read_bytes())
    return load_runs([folder])


def _request(name: str = "version", words: list[object] | None = None) -> bytes:
    import msgpack

    return bytes(msgpack.packb([0, 7, name, [[False], *(words or [])]]))


def _wire(file: Path) -> object:
    incoming = wire.Incoming()
    try:
        incoming.feed(file.read_bytes())
        messages = list(iter(incoming.message, None))
    except Exception as error:  # noqa: BLE001 - the server ends a connection for any of them
        raise wire.NotARequest(str(error).partition("\n")[0]) from None
    return [wire.request(message) for message in messages]


if __name__ == "__main__":
    main()
