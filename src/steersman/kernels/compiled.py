"""How kernels are compiled, and what becomes of a cache that cannot be used."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from typing import Any, TypeVar, cast

# LLVM's second level instead of numba's third: measured, kernels compile in .85 of the time, the
# estimator's in .6, and run as fast or faster. A level that the user has set stays.
os.environ.setdefault("NUMBA_OPT", "2")

from numba import njit

COMPILING = "compiling kernels, once for this version and machine: up to a minute"

F = TypeVar("F", bound=Callable[..., Any])
# numba's own option without a promise; its type stubs do not know it.
_WITHOUT_RUN_TIME: dict[str, Any] = {"_nrt": False}


def allocating(function: F) -> F:
    """Compile a kernel that may allocate.

    With numpy's error model a zero divisor gives infinity or NaN, without a test each time.
    """
    return compiled(function)


def kernel(function: F) -> F:
    """Compile a kernel that allocates nothing.

    Without numba's run time it need not count references to a table's arrays at every call,
    which makes calls between kernels several times faster.
    """
    return compiled(function, **_WITHOUT_RUN_TIME)


def inlined(function: F) -> F:
    """Compile a kernel that is copied into those that call it.

    A call hands over a table array by array, a dozen words for each, which takes longer than what
    a short kernel does with them.
    """
    return compiled(function, forceinline=True, **_WITHOUT_RUN_TIME)


def compiled(function: F, **options: Any) -> F:
    """Compile with numba, through its cache on disk where that can be used, else without it."""
    options["error_model"] = "numpy"
    try:
        made = njit(cache=True, **options)(function)
    except RuntimeError:  # there is no folder that can be written
        tell(
            "no folder for compiled code can be written, so it is compiled at every start; "
            "NUMBA_CACHE_DIR names one"
        )
        return cast("F", njit(**options)(function))
    made._cache = _MendedCache(made._cache)
    return cast("F", made)


@lru_cache
def tell(line: str) -> None:
    """Log a line, once in a process; where nothing is set up for logs, it goes to stderr."""
    logging.getLogger("steersman").warning(line)


class _MendedCache:
    """numba's cache of one function, of which a damaged file counts as missing.

    What is missing is compiled next; that is told, since nothing else shows meanwhile.
    """

    def __init__(self, inner: Any) -> None:
        self._inner = inner

    def load_overload(self, *key: Any) -> Any:
        """The compiled function; None if it is not there, or cannot be read."""
        try:
            found = self._inner.load_overload(*key)
        except Exception:  # noqa: BLE001 - for damaged bytes pickle raises errors of any class
            tell(f"damaged files in {self._inner.cache_path} are compiled anew")
            with suppress(OSError):
                self._inner.flush()
            found = None
        if found is None:
            tell(COMPILING)
        return found

    def save_overload(self, *entry: Any) -> None:
        """Keep a compiled function, if that is possible."""
        with suppress(OSError):
            self._inner.save_overload(*entry)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)
