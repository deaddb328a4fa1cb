"""Episode settings: how the world ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from carla_standin.wire import Refused, optional, shaped

# Period of the asynchronous mode without a fixed one [s].
_FREE_RUNNING = 0.02
# Shortest and longest period and substep [s], and most substeps, that a client may ask for.
_SHORTEST, _LONGEST = 1e-5, 10.0
_MOST_SUBSTEPS = 1000
# What settings look like on the wire, but for the period, which is optional.
_LIKE = (False, False, False, False, 0.0, 0, 0.0, False, 0.0, 0.0, False)


@dataclass(frozen=True)
class EpisodeSettings:
    """What ``world.apply_settings`` sets; the last fields are kept and returned, no more."""

    synchronous: bool = False
    no_rendering: bool = False
    fixed_delta: float | None = None
    substepping: bool = True
    max_substep_delta: float = 0.01
    max_substeps: int = 10
    rest: tuple[Any, ...] = (0.0, True, 3000.0, 2000.0, True)
    """Culling distance, deterministic ragdolls, tile and actor distances, spectator as ego."""

    @classmethod
    def read(cls, values: Any) -> EpisodeSettings:
        """From the wire, checked.

        Raises:
            Refused: it does not fit.
        """
        given = values[2] if isinstance(values, list) and len(values) == len(_LIKE) else None
        fixed = shaped(given[1], 0.0) if isinstance(given, list) and given and given[0] else None
        without = shaped([*values[:2], False, *values[3:]], _LIKE) if given else None
        if without is None:
            raise Refused(f"settings: not the {len(_LIKE)} values that the client of 0.9.16 sends")
        sync, blind, _, sub, h, most, *rest = without
        if fixed is not None and not _SHORTEST <= fixed <= _LONGEST:
            raise Refused(f"fixed_delta_seconds: {fixed} s; {_SHORTEST:g} to {_LONGEST:g} s")
        if sub and not (_SHORTEST <= h <= _LONGEST and 1 <= most <= _MOST_SUBSTEPS):
            raise Refused(
                f"max_substep_delta_time {h} s, max_substeps {most}; "
                f"{_SHORTEST:g} to {_LONGEST:g} s, and 1 to {_MOST_SUBSTEPS}"
            )
        return cls(sync, blind, fixed, sub, h, most, tuple(rest))

    def wire(self) -> list[Any]:
        """As it travels in calls."""
        return [
            self.synchronous,
            self.no_rendering,
            optional(self.fixed_delta),
            self.substepping,
            self.max_substep_delta,
            self.max_substeps,
            *self.rest,
        ]

    def after_loading(self) -> EpisodeSettings:
        """What loading a world with ``reset_settings`` leaves."""
        return replace(self, synchronous=False, fixed_delta=None)

    @property
    def period(self) -> float:
        """Simulated time of a tick [s]."""
        return _FREE_RUNNING if self.fixed_delta is None else self.fixed_delta

    @property
    def substeps(self) -> int:
        """Integration steps of a tick in the client's settings; the simulator may take more."""
        if not self.substepping:
            return 1
        wanted = math.ceil(self.period / self.max_substep_delta - 1e-9)
        return min(max(wanted, 1), self.max_substeps)
