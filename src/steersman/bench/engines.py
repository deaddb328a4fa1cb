"""Where the runs of a benchmark are computed: in this process, over the cores, or on a cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

from steersman.errors import SteersmanError

# A piece of work, and what does it.
Chunk: TypeAlias = Sequence[Any]
Work: TypeAlias = Callable[[Any], Any]
Engine: TypeAlias = Callable[[Work, Sequence[Chunk], int], Iterator[list[Any]]]


def do(work: Work, chunk: Chunk) -> list[Any]:
    """All of a chunk, one after the other."""
    return [work(item) for item in chunk]


def local(work: Work, chunks: Sequence[Chunk], jobs: int) -> Iterator[list[Any]]:
    """Over the cores with joblib; with one job in this very process. In no certain order.

    Raises:
        SteersmanError: a process was killed, by the system for want of memory for example.
    """
    if jobs == 1 or len(chunks) <= 1:
        yield from (do(work, chunk) for chunk in chunks)
        return
    from joblib import Parallel, delayed, parallel_config
    from joblib.externals.loky.process_executor import BrokenProcessPool

    # One thread of BLAS each: the processes are what uses the cores.
    with parallel_config("loky", inner_max_num_threads=1):
        parallel = Parallel(jobs, return_as="generator_unordered", batch_size=1)
        try:
            yield from parallel(delayed(do)(work, chunk) for chunk in chunks)
        except BrokenProcessPool:
            raise SteersmanError(
                "a process of the benchmark was killed; the same command goes on, with fewer "
                "--jobs if memory ran out"
            ) from None


def cluster(work: Work, chunks: Sequence[Chunk], jobs: int) -> Iterator[list[Any]]:
    """On a Ray cluster: the one that ``RAY_ADDRESS`` names, else one on this machine alone.

    Every node needs this package, and policies under the same names. What is started here is
    stopped here; a cluster that was running goes on. In no certain order.
    """
    import ray

    ours = not ray.is_initialized()
    if ours:
        # With an address, CPUs are the cluster's to tell.
        there = bool(os.environ.get("RAY_ADDRESS"))
        own: dict[str, Any] = {} if there else {"num_cpus": jobs, "include_dashboard": False}
        ray.init(log_to_driver=False, configure_logging=False, **own)
    try:
        remote = ray.remote(num_cpus=1, max_retries=2)(do)
        # The function travels once; a few pieces wait beyond those that are computed.
        left: list[Chunk] = list(reversed(chunks))
        running: list[Any] = []
        most = _WAITING * max(int(ray.cluster_resources().get("CPU", 1)), 1)
        shared = ray.put(work)
        while left or running:
            while left and len(running) < most:
                running.append(remote.remote(shared, left.pop()))
            done, running = ray.wait(running)
            yield from ray.get(done)
    finally:
        if ours:
            ray.shutdown()


# Pieces of work handed out for each core of a cluster.
_WAITING = 2
ENGINES: dict[str, Engine] = {"local": local, "ray": cluster}
