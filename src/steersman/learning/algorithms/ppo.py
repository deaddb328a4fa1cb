"""PPO: a stochastic policy that learns from each stretch of its own driving once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import model_validator

from steersman.config import Of, param, register
from steersman.errors import ConfigError
from steersman.learning.algorithms.base import OnPolicyComponent
from steersman.learning.schedules import HoldThenDecay, Schedule

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig
    from steersman.learning.sb3 import SteeringAgent
    from steersman.learning.vec_env import PathFollowingVecEnv


@register("agent", "ppo")
class Ppo(OnPolicyComponent):
    """PPO (Schulman et al., 2017): learns from what its own policy just did, then drops it.

    No replay buffer, and so no extra action of the demonstrator and no mirror images; the
    demonstration's reward works.
    """

    batch: int = param(64, "-", "Transitions in a batch.", ge=2)
    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        HoldThenDecay(start=3e-4, end=2e-5, hold=0.5), "-", "Learning rate of all networks."
    )
    n_steps: int = param(
        128,
        "steps",
        "Steps of each vehicle between trainings; with 16 vehicles the 2048 transitions that "
        "Stable-Baselines3 collects with one.",
        ge=1,
    )
    n_epochs: int = param(10, "-", "Passes over the collected transitions in a training.", ge=1)
    gae_lambda: float = param(
        0.95, "-", "Generalised advantage: 0 one step and the value, 1 whole returns.", ge=0, le=1
    )
    clip_range: float = param(
        0.2, "-", "Largest change of an action's probability that still pays, as a ratio - 1.", gt=0
    )
    clip_range_vf: float | None = param(
        None, "-", "Largest change of a value in a training, in units of value; null: any.", gt=0
    )
    normalize_advantage: bool = param(True, "-", "Advantages of a batch to mean 0, deviation 1.")
    ent_coef: float = param(0.0, "-", "Weight of the entropy in the loss.", ge=0)
    vf_coef: float = param(0.5, "-", "Weight of the values' error in the loss.", gt=0)
    target_kl: float | None = param(
        None, "nat", "A training ends early beyond 1.5 times this divergence; null: never.", gt=0
    )
    log_std_init: float = param(
        -1.5, "-", "Logarithm of the first policy's deviation; Stable-Baselines3's is 0."
    )
    activation: Literal["tanh", "relu"] = param("tanh", "-", "After the hidden layers.")

    @model_validator(mode="after")
    def _whole_batches(self) -> Ppo:
        collected = self.n_steps * self.vehicles
        if collected % self.batch:
            raise ConfigError(
                f"{self.batch} does not divide n_steps x vehicles = {collected}", ("batch",)
            )
        return self

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> SteeringAgent:
        """The agent of a training configuration, which holds this component."""
        from steersman.learning.on_policy import make_on_policy

        return make_on_policy(self, config, env)

    @property
    def operators(self) -> tuple[str, str]:
        """ONNX operators after the policy's hidden layers and after its output."""
        return self.activation.capitalize(), "Clip"
