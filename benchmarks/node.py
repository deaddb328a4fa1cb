"""Round trips of a node at 1 kHz, beside those of a program that only sends back what it gets.

    python benchmarks/node.py [tuned/lqr ...] [--count 10000] [--out results/node]

Both are programs of their own on 127.0.0.1 (UDP); this one asks them in turn, so that the load of
the machine is the same for both. A question is a record or a line of JSON with 15 waypoints of a
straight road; the node computes a whole step of the controller, the other one sends the same bytes.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from steersman.controllers.exchange import Question, to_json, to_record
from steersman.delivery.observations import straight
from steersman.files import write_text
from steersman.provenance import provenance

CONTROLLERS = ("tuned/lqr", "tuned/mpc_delay", "tuned/mpc_delay --compiled", "precision")
ECHO = """
import socket
line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
line.bind(("127.0.0.1", 0))
print(line.getsockname()[1], flush=True)
while True:
    message, sender = line.recvfrom(65535)
    line.sendto(message, sender)
"""
PERIOD = 1e-3


def started(words: list[str]) -> tuple[subprocess.Popen[str], socket.socket]:
    """A program that answers, and a socket connected to it."""
    node = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert node.stdout is not None
    assert node.stderr is not None
    port = 0
    while not port:
        line = node.stdout.readline() if words[1] == "-c" else node.stderr.readline()
        found = line.partition("127.0.0.1:")[2].split() or line.split()[:1]
        port = int(found[0]) if found and found[0].isdecimal() else 0
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.settimeout(2.0)
    made.connect(("127.0.0.1", port))
    return node, made


def measured(word: str, form: str, count: int) -> dict[str, object]:
    """Quantiles of both round trips [ms]."""
    seen = straight(15, 2.0)._replace(lateral_error=0.1)
    node, asked = started([sys.executable, "-m", "steersman", "node", *word.split(), "--udp", "0"])
    echo, other = started([sys.executable, "-c", ECHO])
    times = np.zeros((count, 2))
    begun = time.perf_counter()
    for i in range(count):
        question = Question(seen, sequence=i)
        line = to_record(question) if form == "record" else json.dumps(to_json(question)).encode()
        for j, socket_ in enumerate((asked, other)):
            sent = time.perf_counter()
            socket_.send(line)
            answer = socket_.recv(65535)
            times[i, j] = time.perf_counter() - sent
            assert j or b'"error"' not in answer
        time.sleep(max(begun + PERIOD * (i + 1) - time.perf_counter(), 0.0))
    took = time.perf_counter() - begun
    for program, socket_ in ((node, asked), (echo, other)):
        socket_.close()
        program.terminate()
        program.communicate(timeout=20)
    milli = 1e3 * np.quantile(times, [0.5, 0.99, 1.0], axis=0)
    names = ("median_ms", "p99_ms", "longest_ms")
    return {
        "controller": word,
        "form": form,
        "questions_per_second": count / took,
        **{f"node_{name}": float(value) for name, value in zip(names, milli[:, 0], strict=True)},
        **{f"echo_{name}": float(value) for name, value in zip(names, milli[:, 1], strict=True)},
    }


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("controllers", nargs="*", default=CONTROLLERS)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    found = [
        measured(word, form, given.count)
        for word in given.controllers
        for form in ("record", "json")
    ]
    lines = [
        "| controller | form | node: median, 99 %, longest [ms] | echo: the same | questions / s |",
        "|---|---|---|---|---|",
    ]
    for one in found:
        node, echo = (
            ", ".join(
                f"{one[f'{side}_{name}']:.3f}" for name in ("median_ms", "p99_ms", "longest_ms")
            )
            for side in ("node", "echo")
        )
        rate = one["questions_per_second"]
        lines.append(f"| {one['controller']} | {one['form']} | {node} | {echo} | {rate:.0f} |")
    print("\n".join(lines))  # noqa: T201
    if given.out is not None:
        given.out.mkdir(parents=True, exist_ok=True)
        write_text(given.out / "table.md", "\n".join(lines) + "\n")
        record = {"count": given.count, "rows": found, **provenance()}
        write_text(given.out / "results.json", json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
