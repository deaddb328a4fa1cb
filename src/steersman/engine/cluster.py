"""Workers on a Ray cluster: the one that ``RAY_ADDRESS`` names, else one on this machine alone.

Every node needs this package, and files under the same names.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import chdir, nullcontext, suppress
from typing import Any

from steersman.engine.work import Listener, Outcome, Piece, perform
from steersman.errors import one_line

# Pieces handed out for each core of the cluster; and how often messages are fetched [s].
_HANDED_OUT = 2
_INTERVAL = 0.3
# Times that a piece is begun again if its node is lost.
_RETRIES = 2


class RayCluster:
    """Tasks of one core each; with ``apart`` each piece has a process of its own."""

    def __init__(self, at_once: int | None, *, apart: bool, threads: int, cores: int) -> None:
        """Connect, or start a cluster of ``at_once`` or ``cores`` CPUs, which ``close`` stops."""
        import ray

        self._ours = not ray.is_initialized()
        if self._ours:
            there = bool(os.environ.get("RAY_ADDRESS"))  # with an address, CPUs are the cluster's
            own: dict[str, Any] = {"num_cpus": at_once or cores, "include_dashboard": False}
            # Ray's workers import from the directory in which it is started: only if this does.
            here = nullcontext() if {"", os.getcwd()} & {*sys.path} else chdir(os.sep)
            with here:
                ray.init(log_to_driver=False, configure_logging=False, **({} if there else own))
        self.at_once = at_once or max(int(ray.cluster_resources().get("CPU", 1)) // threads, 1)
        self._most = at_once or _HANDED_OUT * self.at_once
        options = {"max_calls": 1, "max_retries": 0} if apart else {"max_retries": _RETRIES}
        self._task = ray.remote(num_cpus=threads, **options)(_task)
        self._mailbox = ray.remote(num_cpus=0)(_Mailbox).remote()

    def outcomes(self, pieces: Sequence[Piece], listener: Listener) -> Iterator[list[Outcome]]:
        """The outcomes of each piece, in the order in which they end."""
        import ray

        waiting, running = list(reversed(pieces)), dict[Any, Piece]()
        try:
            while waiting or running:
                while waiting and len(running) < self._most:
                    piece = waiting.pop()
                    running[self._task.remote(piece.data, os.getcwd(), self._mailbox)] = piece
                ended, _ = ray.wait(list(running), timeout=_INTERVAL)
                for key, event in ray.get(self._mailbox.take.remote()):
                    listener(key, event)
                for task in ended:
                    piece = running.pop(task)
                    try:
                        found = ray.get(task)
                    except ray.exceptions.RayError as error:
                        found = piece.lost(one_line(str(error)))
                    yield found
        finally:
            for task in running:
                ray.cancel(task, force=True)

    def close(self) -> None:
        """Stop what was started here; a cluster that was running goes on."""
        import ray

        ray.kill(self._mailbox)
        if self._ours:
            ray.shutdown()


class _Mailbox:
    """Events of jobs, on their way to the caller."""

    def __init__(self) -> None:
        self._events: list[tuple[str, Any]] = []

    def put(self, key: str, event: Any) -> None:
        self._events.append((key, event))

    def take(self) -> list[tuple[str, Any]]:
        taken, self._events = self._events, []
        return taken


def _task(data: bytes, folder: str, mailbox: Any) -> list[Outcome]:
    """A piece of work on a node, in the caller's working directory if the node has it."""
    import ray

    with suppress(OSError):
        os.chdir(folder)
    # Each event has arrived before the job goes on, and so before its result.
    return perform(data, lambda key, event: ray.get(mailbox.put.remote(key, event)))
