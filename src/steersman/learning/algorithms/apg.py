"""APG: the policy follows the gradient of its reward through the car itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

from steersman.config import Of, param, register
from steersman.learning.algorithms.base import OnPolicyComponent
from steersman.learning.schedules import HoldThenDecay, Schedule

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig
    from steersman.learning.sb3 import SteeringAgent
    from steersman.learning.vec_env import PathFollowingVecEnv


@register("agent", "apg")
class Apg(OnPolicyComponent):
    """Analytic policy gradients over a short horizon; with a critic, SHAC (Xu et al., 2022).

    The rewards of a stretch of driving are differentiated by the policy's weights through the
    embedded simulator's own equations. No exploration, no replay buffer, no extra action of the
    demonstrator; the demonstration's reward works.
    """

    joint: ClassVar[bool] = False
    gamma: float = param(0.99, "-", "Discount per control step.", gt=0, lt=1)
    batch: int = param(1024, "-", "Transitions in a batch of the critic.", ge=1)
    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        HoldThenDecay(start=2e-3, end=4e-5, hold=0.4), "-", "Learning rate of all networks."
    )
    vehicles: int = param(128, "-", "Vehicles that collect at the same time.", ge=1, le=1024)
    horizon: int = param(40, "steps", "Steps of each vehicle that are differentiated.", ge=1)
    critic: bool = param(False, "-", "Value what comes after the horizon; off: it does not count.")
    critic_epochs: int = param(2, "-", "Passes of the critic over a stretch of driving.", ge=1)
    td_lambda: float = param(
        0.95, "-", "Critic's target: 0 one step and the value, 1 the stretch's return.", ge=0, le=1
    )
    tau: float = param(0.2, "-", "Share by which the target critic follows.", gt=0, le=1)
    mirror: bool = param(
        True, "-", "Every other vehicle drives by the policy's mirror image, left for right."
    )

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> SteeringAgent:
        """The agent of a training configuration, which holds this component."""
        from steersman.learning.analytic import make_analytic

        return make_analytic(self, config, env)

    @property
    def operators(self) -> tuple[str, str]:
        """ONNX operators after the policy's hidden layers and after its output."""
        return "Relu", "Clip"
