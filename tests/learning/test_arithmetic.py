"""A training computes with the threads that were asked for, whatever the machine has."""

from __future__ import annotations

import os
import subprocess
import sys

CODE = """
from steersman.learning.arithmetic import arithmetic
with arithmetic(1):
    import scipy.linalg.cython_blas, threadpoolctl  # as numba does for a kernel's first product
    print({one["num_threads"] for one in threadpoolctl.threadpool_info()})
"""


def test_every_library_keeps_to_the_threads() -> None:
    """In a process of its own: which libraries are there when the limit is set decides."""
    done = subprocess.run(
        (sys.executable, "-c", CODE),
        env={**os.environ, "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip() == "{1}", done.stderr
