"""How kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])
# numba's own option without a promise; its type stubs do not know it.
_WITHOUT_RUN_TIME: dict[str, Any] = {"_nrt": False}


def allocating(function: F) -> F:
    """Compile a kernel that may allocate.

    With numpy's error model a zero divisor gives infinity or NaN, without a test each time.
    """
    return cast("F", njit(cache=True, error_model="numpy")(function))


def kernel(function: F) -> F:
    """Compile a kernel that allocates nothing.

    Without numba's run time it need not count references to a table's arrays at every call,
    which makes calls between kernels several times faster.
    """
    return cast("F", njit(cache=True, error_model="numpy", **_WITHOUT_RUN_TIME)(function))
