"""What came of a run, as a value: how it ended, what was driven, and what failed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from steersman import episode as ending
from steersman.episode import Episode
from steersman.errors import ControllerError, PlantError
from steersman.kernels import world as kernel

Outcome: TypeAlias = Literal[
    "finished", "left_road", "rolled_over", "collided", "overran", "timed_out", "controller_failed",
    "plant_failed",
]  # fmt: skip
# Outcomes by the end that an episode names; of all others a run is finished.
OUTCOMES: dict[str, Outcome] = {
    ending.OFF_TRACK: "left_road",
    ending.ROLL_OVER: "rolled_over",
    ending.COLLISION: "collided",
    ending.OVERRUN: "overran",
    ending.TIMEOUT: "timed_out",
}
# Ends by the kernel's reason, but for those that depend on what was planned.
ENDS = {
    kernel.LEFT_CORRIDOR: ending.OFF_TRACK,
    kernel.ROLLED: ending.ROLL_OVER,
    kernel.COLLIDED: ending.COLLISION,
    kernel.OVERRAN: ending.OVERRUN,
    kernel.GOAL_REACHED: ending.END_OF_PATH,
}


def end_of(reason: int) -> str:
    """The end that a kernel's reason for it is; empty while the drive goes on.

    >>> end_of(kernel.LEFT_CORRIDOR), end_of(kernel.RUNNING)
    ('off_track', '')
    """
    return "" if reason == kernel.RUNNING else ENDS.get(reason, ending.DURATION)


@dataclass(frozen=True)
class Attempt:
    """What came of a run.

    Attributes:
        outcome: how the run ended; ``"finished"`` is its planned end.
        episode: what was driven; until the failure, where something failed.
        error: what failed: a ``RunError`` or a ``PlantFailure``; None where nothing did.
    """

    outcome: Outcome
    episode: Episode
    error: RunError | PlantFailure | None = None

    def of_controller(self) -> Episode:
        """The episode as a result of the controller, whose failure is one; a plant's is not.

        Raises:
            PlantFailure: the plant failed while it was driven.
        """
        if isinstance(self.error, PlantFailure):
            raise self.error
        return self.episode


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while a run was driven; ``episode`` holds what was driven until then."""

    def __init__(self, episode: Episode) -> None:
        """Keep the episode."""
        super().__init__(episode)
        self.episode = episode


class RunError(ControllerError):
    """A run that failed; ``episode`` holds what was driven until then."""

    def __init__(self, message: str, episode: Episode) -> None:
        """Keep the episode beside the message."""
        super().__init__(message)
        self.episode = episode


class PlantFailure(PlantError):
    """A plant that failed in mid-run; ``episode`` holds what was driven until then."""

    def __init__(self, message: str, episode: Episode) -> None:
        """Keep the episode beside the message."""
        super().__init__(message)
        self.episode = episode
