"""Settings of the whole process under which a training computes, and repeats."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def arithmetic(threads: int) -> Iterator[None]:
    """As many threads as asked for, and denormals flushed to zero; as before afterwards.

    Denormals make the networks many times slower on some processors. Distributions take what they
    are given: NaN goes through them to the losses, where it is looked for.
    """
    # Compiled kernels multiply with SciPy's library, which is limited only if it is there by then.
    import scipy.linalg.cython_blas  # noqa: F401
    import threadpoolctl
    import torch
    from torch.distributions import Distribution

    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)
    validates = Distribution._validate_args
    Distribution.set_default_validate_args(False)
    try:
        with threadpoolctl.threadpool_limits(threads):
            yield
    finally:
        Distribution.set_default_validate_args(validates)
        torch.set_flush_denormal(False)
        torch.set_num_threads(before)
