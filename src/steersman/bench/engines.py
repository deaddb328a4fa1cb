"""Where the runs of a benchmark are computed: in this process, or over the cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

# A piece of work, and what does it.
Chunk: TypeAlias = Sequence[Any]
Work: TypeAlias = Callable[[Any], Any]
Engine: TypeAlias = Callable[[Work, Sequence[Chunk], int], Iterator[list[Any]]]


def do(work: Work, chunk: Chunk) -> list[Any]:
    """All of a chunk, one after the other."""
    return [work(item) for item in chunk]


def local(work: Work, chunks: Sequence[Chunk], jobs: int) -> Iterator[list[Any]]:
    """Over the cores with joblib; with one job in this very process. In no certain order."""
    if jobs == 1 or len(chunks) <= 1:
        yield from (do(work, chunk) for chunk in chunks)
        return
    from joblib import Parallel, delayed, parallel_config

    # One thread of BLAS each: the processes are what uses the cores.
    with parallel_config("loky", inner_max_num_threads=1):
        parallel = Parallel(jobs, return_as="generator_unordered", batch_size=1)
        yield from parallel(delayed(do)(work, chunk) for chunk in chunks)


ENGINES: dict[str, Engine] = {"local": local}
