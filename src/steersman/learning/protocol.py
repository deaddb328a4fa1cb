"""What the training loop asks of an agent, whatever its algorithm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from steersman.learning.snapshot import Tree
from steersman.learning.updates import Net


class Agent(Protocol):
    """An algorithm of Stable-Baselines3 as the training loop sees it."""

    num_timesteps: int
    """Environment steps of all vehicles together."""
    _n_updates: int
    sampled_steps: int
    """Actions that the policy was asked for."""
    demonstrated_steps: int
    """Actions of the demonstrator."""
    saturated_steps: int
    """Actions that the policy wanted to be at a limit, before any noise."""
    last_losses: tuple[float, float, float]
    """Actor's and critic's loss and mean value, of the last training; NaN before."""
    demonstrable: bool
    """Whether the demonstrator may act."""

    @property
    def learn(self) -> Callable[..., Any]:
        """Collect and train, as Stable-Baselines3 does."""

    @property
    def predict(self) -> Callable[..., Any]:
        """The policy's actions, as Stable-Baselines3 has them."""

    def act(self, features: Any) -> Any:
        """The policy's actions (n,) in [-1, 1] for features (n, k), without noise."""

    def actor_net(self) -> Net:
        """The policy's weights; what stands between its layers is the configuration's."""

    def weights(self) -> dict[str, Any]:
        """All weights and the optimisers' moments, as arrays that share their memory."""

    def current_rate(self) -> float:
        """Learning rate of the next update."""

    def snapshot(self) -> dict[str, Any]:
        """All that changes from step to step, the environment apart; taken between two steps."""

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
