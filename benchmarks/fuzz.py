"""Damaged files against every reader: an answer or one line, in bounded time and memory.

    python benchmarks/fuzz.py [--seconds 60] [--inputs 100000] [--seed 0] [--only TARGET]
                              [--corpus DIR] [--out results/fuzz]

Each target has a small corpus of its own making, and the files of ``--corpus`` with its suffix. An
input is one of its files with a few bytes, words or stretches changed, doubled, cut or taken from
another, by a seeded generator. What ends in anything but an answer or a ``SteersmanError``, also
after 20 s, is a fault, and its input is kept in ``--out``.
"""

from __future__ import annotations

import argparse
import json
import logging
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from fuzz_targets import MOST_BYTES, Target, targets

import steersman as sm
from steersman.files import write_text
from steersman.provenance import provenance

SLOWEST, LARGEST = 10.0, 500.0
"""A reading that takes longer [s], or makes the process grow by more [MB], is a fault."""
_IN_MEMORY = Path("/dev/shm")  # writing to a disk would be most of the time
_WORDS = (
    *(b"", b"0", b"-1", b"1e308", b"nan", b"9" * 400, b"null", b"[", b"{", b"&a", b"*a", b"\xff"),
)


def main() -> None:
    """Fuzz each target for a while and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="CPU time of each target [s]")
    parser.add_argument("--inputs", type=int, default=100_000, help="inputs of each, at most")
    parser.add_argument("--corpus", type=Path, help="a folder with more files to begin with")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="one target alone")
    parser.add_argument("--out", type=Path, default=Path("results/fuzz"))
    words = parser.parse_args()
    signal.signal(signal.SIGVTALRM, stopped)
    logging.disable()  # the stand-in logs every call that it does not know
    warnings.simplefilter("error", RuntimeWarning)  # they would be lines of their own
    made = {"cpu_seconds": words.seconds, "seed": words.seed, **provenance()}
    rows = []
    with tempfile.TemporaryDirectory(dir=_IN_MEMORY if _IN_MEMORY.is_dir() else None) as folder:
        place = Path(folder)
        for name, target in targets(place).items():
            if words.only in {None, name}:
                rows.append(fuzz(name, target, place, words))
                sys.stdout.write(json.dumps(rows[-1]) + "\n")
                sys.stdout.flush()
                table = json.dumps({"made": made, "rows": rows}, indent=1)
                write_text(words.out / "table.json", table + "\n")
    raise SystemExit(any(row["faults"] for row in rows))


def fuzz(name: str, target: Target, place: Path, words: argparse.Namespace) -> dict[str, object]:
    """One row of the table."""
    rng = np.random.default_rng(words.seed)
    file = place / f"input{target.suffix}"
    for data in target.corpus:  # what is whole is read
        file.write_bytes(data)
        target.read(file)
    corpus = [*target.corpus, *more(words.corpus, target.suffix)]
    begun, inputs, answered, slowest = time.process_time(), 0, 0, 0.0
    found: dict[str, bytes] = {}
    before = memory()
    while time.process_time() - begun < words.seconds and inputs < words.inputs:
        data = damaged(corpus, rng)
        file.write_bytes(data)
        start = time.process_time()
        fault = tried(target.read, file)
        answered += fault is None
        took = time.process_time() - start
        if took > SLOWEST:
            fault = f"{fault or ''} took too long".strip()
        if memory() - before > LARGEST:
            fault, before = f"{fault or ''} took too much memory".strip(), memory()
        if fault:
            found.setdefault(fault, data)
        slowest, inputs = max(slowest, took), inputs + 1
    for k, data in enumerate(found.values()):
        kept = words.out / f"{name}_{k}{target.suffix}"
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_bytes(data)
    return {
        "target": name,
        "inputs": inputs,
        "answered": answered,
        "slowest_s": round(slowest, 3),
        "grown_mb": round(memory() - before, 1),
        "faults": sorted(found),
    }


def tried(read: Callable[[Path], object], file: Path) -> str | None:
    """None: an answer; "": an error of one line; else what went wrong."""
    signal.setitimer(signal.ITIMER_VIRTUAL, 2.0 * SLOWEST)
    try:
        read(file)
    except sm.SteersmanError as error:
        return "more than a line" if "\n" in str(error) else ""
    except Exception as error:  # noqa: BLE001 - whatever comes is what is looked for
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} in {Path(last.filename).name}:{last.name}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    return None


def stopped(*_: object) -> None:
    """End a reading that takes far too long."""
    raise TimeoutError


def more(folder: Path | None, suffix: str) -> list[bytes]:
    """The files of a folder with that suffix, small ones."""
    if folder is None:
        return []
    files = sorted(file for file in folder.rglob(f"*{suffix}") if file.is_file())
    return [file.read_bytes() for file in files if file.stat().st_size < MOST_BYTES]


def memory() -> float:
    """Most memory that the process, or one that it started, has had [MB]."""
    both = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return max(resource.getrusage(who).ru_maxrss for who in both) / 1e3


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


if __name__ == "__main__":
    main()
