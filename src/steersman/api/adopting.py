"""A network trained elsewhere becomes a controller, after a check drive."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

from steersman.api.driving import Folder, drive
from steersman.config import lay_over, override
from steersman.metrics.base import summarise

if TYPE_CHECKING:
    from steersman.episode import Episode

# The road of the check drive, its speed [m/s], and its duration [s].
_ROAD, _SPEED, _SECONDS = "figure_eight", 6.0, 30.0
# Waypoints that a sensor gives at least.
_WAYPOINTS = 15


class Adopted(NamedTuple):
    """A network that has become a controller."""

    file: FilePath
    """The policy, ``policy.onnx``, with its card beside it: ``controller=policy``."""
    episode: Episode
    """The check drive."""
    described: bool = False
    """Whether the model's file said what it reads, as one from our environment does."""

    def __str__(self) -> str:
        """The check drive in one line."""
        found = summarise(self.episode)
        kept = "stayed on the road" if self.episode.completed else f"ended by {self.episode.end}"
        return (
            f"check drive, {_ROAD} at {_SPEED:g} m/s: {kept} after {found['duration_s']:.1f} s, "
            f"mean lateral error {found['mean_abs_lateral_error_m']:.3f} m, "
            f"largest {found['max_abs_lateral_error_m']:.3f} m"
        )


def adopt(model: Folder, *words: str, out: Folder, **settings: Any) -> Adopted:
    """Make a controller from a model of Stable-Baselines3 or an ONNX file.

    The model is never unpickled. The check drive shows whether features, units and signs are those
    that the network was trained with; a drive that leaves the road says that they are not.

    Args:
        model: a ``.zip`` of ``model.save`` (DDPG, TD3, SAC, PPO, A2C with ``MlpPolicy``), or an
            ``.onnx`` file of layers.
        words: assignments ``key=value`` of :class:`~steersman.learning.adopt.Adoption`.
        out: folder for ``policy.onnx`` and ``policy.json``.
        settings: the same by name. ``encoding`` is needed, but for a model that was trained in
            ``steersman/PathFollowing-v0``, whose file says all of it.

    Raises:
        ConfigError: a setting is unknown, not allowed, or does not fit the network.
        DataError: the file is no network that can be adopted, or ``out`` cannot be written.
    """
    from steersman.learning.adopt import adopt_policy, adoption, told_by

    tree: dict[str, Any] = {}
    for key, value in settings.items():
        tree = lay_over(tree, key, value)
    wanted = adoption(FilePath(model), override(tree, words))
    file = adopt_policy(FilePath(model), wanted, out)
    episode = drive(
        controller={"kind": "policy", "file": str(file)},
        path=_ROAD,
        speed={"kind": "constant_speed", "speed": _SPEED},
        plant={"dt": wanted.dt},
        sensor={"count": max(wanted.layout.reads, _WAYPOINTS), "spacing": wanted.spacing},
        duration=_SECONDS,
    )
    return Adopted(file, episode, bool(told_by(FilePath(model))))
