"""Settings of the whole process under which a training computes, and repeats."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def arithmetic(threads: int) -> Iterator[None]:
    """As many threads as asked for, and denormals flushed to zero; as before afterwards.

    Denormals make the networks many times slower on some processors.
    """
    import threadpoolctl
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)
    try:
        with threadpoolctl.threadpool_limits(threads):
            yield
    finally:
        torch.set_flush_denormal(False)
        torch.set_num_threads(before)
