"""What is left between simulated and measured signals, and how it changes with the unknowns.

Unknowns are z, standardised: 0 is the prior value, 1 is one prior standard deviation above it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify.unknowns import Unknown
from steersman.types import FloatArray

_STEP = 1e-3
# A derivative is taken for the same as long as no unknown has moved further than this (in z):
# a few per cent of a stiffness, which change its slopes by as much.
_SAME = 0.2


class Misses:
    """Simulated minus measured signals of a vehicle at z, and how they change with z."""

    def __init__(
        self,
        of: Callable[[FloatArray], FloatArray],
        unknowns: Sequence[Unknown],
        least: FloatArray,
    ) -> None:
        """Bind z to what is compared.

        Args:
            of: z -> (rows, channels) simulated minus measured, NaN where nothing compares.
            unknowns: what the elements of z (p,) are.
            least: (channels,) standard deviations below which no residual is taken for noise.
        """
        self._of, self._least = of, least
        self.low, self.high = np.array([u.bounds() for u in unknowns]).T
        self.need = np.array([u.need_z for u in unknowns])
        """(p,) half width of the 95 % interval beyond which an unknown is not determined."""
        self.names = [u.name for u in unknowns]
        self._coarse = np.array([u.coarse for u in unknowns])
        self._last: tuple[FloatArray, FloatArray] | None = None
        self._slopes: dict[tuple[int, bool], tuple[FloatArray, FloatArray]] = {}

    def __call__(self, z: FloatArray) -> FloatArray:
        """(rows, channels)."""
        if self._last is None or not np.array_equal(self._last[0], z):
            self._last = z.copy(), self._of(z)
        return self._last[1]

    def scales(self, z: FloatArray) -> FloatArray:
        """Standard deviation of each channel's residuals, by their median: (channels,)."""
        return np.maximum(scale_of(self(z)), self._least)

    def derivative(self, z: FloatArray, which: Any = None, *, wide: bool = False) -> FloatArray:
        """(rows, channels, len(which)) by small differences away from the nearer bound.

        If ``wide``, to both sides, and over as much as the unknowns' ``coarse``, for intervals.
        Those of a place nearby are used again.
        """
        which = np.arange(len(z)) if which is None else which
        return np.stack([self._slope(z, int(i), wide) for i in which], axis=-1)

    def _slope(self, z: FloatArray, i: int, wide: bool) -> FloatArray:
        at, slope = self._slopes.get((i, wide), (z, None))
        if slope is None or float(np.max(np.abs(z - at))) > _SAME:
            slope = self._difference(z, i, wide)
            self._slopes[i, wide] = z.copy(), slope
        return slope

    def _difference(self, z: FloatArray, i: int, wide: bool) -> FloatArray:
        ends = [(z[i], self(z))]
        up = self.high[i] - z[i] > z[i] - self.low[i]
        step = max(self._coarse[i], _STEP) if wide else _STEP
        for side in (-1.0, 1.0) if wide else (1.0 if up else -1.0,):
            moved = z.copy()
            moved[i] = min(max(z[i] + side * step, self.low[i]), self.high[i])
            ends.append((moved[i], self._of(moved)))
        (low, before), (high, after) = ends[-2:]
        return np.asarray((after - before) / (high - low))


class Selection(NamedTuple):
    """Which unknowns are searched, and where and how uncertain the held ones are."""

    wanted: Any
    """(p,) bool: those that are searched."""
    rest: FloatArray
    """(p,) z of those that are held, or not determined."""
    unsure: FloatArray
    """(p,) standard deviation of those that are held."""

    @classmethod
    def of(cls, misses: Misses, rest: FloatArray | None = None) -> Selection:
        """All unknowns; what is not determined returns to ``rest`` or the prior."""
        p = len(misses.need)
        return cls(np.full(p, True), np.zeros(p) if rest is None else rest, np.ones(p))

    def without(self, which: Any) -> Selection:
        """The same, but with the unknowns at ``which`` held."""
        wanted = np.array(self.wanted)
        wanted[which] = False
        return Selection(wanted, self.rest, self.unsure.copy())


def scale_of(misses: FloatArray) -> FloatArray:
    """Standard deviation of each channel's residuals, by their median: (channels,)."""
    out = np.ones(misses.shape[1])
    for k, column in enumerate(misses.T):
        known = column[np.isfinite(column)]
        if known.size:
            spread = 1.4826 * float(np.median(np.abs(known - np.median(known))))
            out[k] = spread
    return out
