"""Steering to and fro: reversals of what the car's lateral acceleration differs from the road's."""

from __future__ import annotations

from typing import NamedTuple


class Swings(NamedTuple):
    """Where the signal turned back, as far as that was not long ago."""

    turned: float | None = None
    """Extreme value since the last reversal [m/s^2]."""
    direction: int = 0
    """Whether the signal has risen (1) or fallen (-1) since."""
    ages: tuple[float, ...] = ()
    """How long ago each reversal was [s]."""

    def after(self, value: float, gap: float, window: float, dt: float) -> Swings:
        """One step later.

        Args:
            value: of the signal [m/s^2].
            gap: turning back by less is no reversal [m/s^2].
            window: how long a reversal is remembered [s].
            dt: control period [s].
        """
        ages = tuple(age + dt for age in self.ages if age + dt < window)
        if self.turned is None:
            return Swings(value, 0, ages)
        moved = value - self.turned
        way = 1 if moved > 0.0 else -1
        if moved != 0.0 and self.direction in (0, way):
            return Swings(value, way, ages)
        if abs(moved) < gap:
            return self._replace(ages=ages)
        return Swings(value, way, (*ages, 0.0))
