"""What can be told to each learning algorithm. Defaults are Stable-Baselines3's unless noted."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from steersman.config import Component, Of, components, param, register
from steersman.errors import ConfigError
from steersman.learning.schedules import Constant, HoldThenDecay, Schedule

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig
    from steersman.learning.demonstration import Demonstration
    from steersman.learning.protocol import Agent
    from steersman.learning.vec_env import PathFollowingVecEnv

# An action is demonstrated where its probability is above zero at one of so many steps.
_LOOKS = 1000


class AgentComponent(Component):
    """A learning algorithm: networks, updates and exploration."""

    hidden: tuple[int, int] = param((128, 128), "-", "Units of the two hidden layers.")
    gamma: float = param(0.95, "-", "Discount per control step.", gt=0, lt=1)
    batch: int = param(256, "-", "Transitions in a batch.", ge=1)
    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        HoldThenDecay(start=1e-3, end=2e-5, hold=0.5), "-", "Learning rate of all networks."
    )
    vehicles: int = param(16, "-", "Vehicles that collect at the same time.", ge=1, le=1024)

    @model_validator(mode="before")
    @classmethod
    def _options_of_others(cls, given: object) -> object:
        for name in set(given) - set(cls.model_fields) if isinstance(given, Mapping) else ():
            kinds = [k for k, other in components("agent").items() if name in other.model_fields]
            if kinds:
                raise ConfigError(f"is an option of {', '.join(kinds)}, not of {cls.kind}", (name,))
        return given

    @abstractmethod
    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> Agent:
        """The agent of a training configuration, which holds this component."""

    def check(self, demonstration: Demonstration, steps: int) -> None:
        """Whether it can learn from the demonstration over so many environment steps.

        Raises:
            ConfigError: it cannot.
        """

    @property
    def operators(self) -> tuple[str, str]:
        """ONNX operators after the policy's hidden layers and after its output."""
        return "Relu", "Tanh"

    @property
    def first_actor_update(self) -> int:
        """The number of updates after which the actor has a loss."""
        return 1


class OffPolicy(AgentComponent):
    """What learns from a replay buffer."""

    tau: float = param(0.005, "-", "Share by which targets follow at each update.", gt=0, le=1)
    buffer: int = param(300_000, "-", "Transitions in the replay buffer.", ge=1)
    updates: int = param(4, "-", "Updates after each step of all vehicles.", ge=0)
    mirror: bool = param(
        False, "-", "Learn from mirror images, left for right, in half of each batch."
    )
    learning_starts: int = param(2000, "steps", "Random actions before learning.", ge=0)


class Deterministic(OffPolicy):
    """A deterministic policy, which explores by noise on its action."""

    noise: Annotated[Schedule, Of("schedule")] = param(
        Constant(at=0.2), "-", "sigma of the Ornstein-Uhlenbeck noise, of the action range."
    )
    noise_theta: float = param(0.15, "-", "Return of the noise to zero per step.", gt=0, le=1)
    noise_dt: float = param(
        1.0, "-", "Time step of the noise; 0.01 is Stable-Baselines3's, slow and persistent.", gt=0
    )


@register("agent", "ddpg")
class Ddpg(Deterministic):
    """DDPG (Lillicrap et al., 2016): one critic, an update of the actor with each of its own."""

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> Agent:
        """The agent of a training configuration, which holds this component."""
        from steersman.learning.agent import make_ddpg

        return make_ddpg(config, env, self)


@register("agent", "td3")
class Td3(Deterministic):
    """TD3 (Fujimoto et al., 2018): the smaller of two critics, noise on targets, a later actor."""

    policy_delay: int = param(2, "updates", "Actor and targets follow once in so many.", ge=1)
    target_policy_noise: float = param(
        0.2, "-", "Standard deviation of the noise on the targets' actions in [-1, 1].", ge=0
    )
    target_noise_clip: float = param(
        0.5, "-", "Largest noise on the targets' actions in [-1, 1].", ge=0
    )

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> Agent:
        """The agent of a training configuration, which holds this component."""
        from steersman.learning.td3 import make_td3

        return make_td3(config, env, self)

    @property
    def first_actor_update(self) -> int:
        """The number of updates after which the actor has a loss."""
        return self.policy_delay


@register("agent", "sac")
class Sac(OffPolicy):
    """SAC (Haarnoja et al., 2018): a stochastic policy, paid for its entropy; two critics."""

    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        HoldThenDecay(start=3e-4, end=2e-5, hold=0.5),
        "-",
        "Learning rate of all networks and of the entropy's coefficient.",
    )
    ent_coef: Annotated[float, Field(gt=0)] | Literal["auto"] = param(
        "auto", "-", "Coefficient of the entropy in the reward, > 0; auto: learned."
    )
    ent_coef_start: float = param(1.0, "-", "Where the learned coefficient starts.", gt=0)
    target_entropy: float | None = param(
        None, "nat", "Entropy that the learned coefficient aims at; null: -1 for each action."
    )

    @model_validator(mode="after")
    def _learned_only(self) -> Sac:
        for name in ("ent_coef_start", "target_entropy"):
            changed = getattr(self, name) != type(self).model_fields[name].default
            if self.ent_coef != "auto" and changed:
                raise ConfigError(
                    f"belongs to ent_coef: auto; ent_coef is {self.ent_coef}", (name,)
                )
        return self

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> Agent:
        """The agent of a training configuration, which holds this component."""
        from steersman.learning.sac import make_sac

        return make_sac(config, env, self)


@register("agent", "ppo")
class Ppo(AgentComponent):
    """PPO (Schulman et al., 2017): learns from what its own policy just did, then forgets it.

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
    n_epochs: int = param(10, "-", "How often each transition is learned from.", ge=1)
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
    max_grad_norm: float = param(0.5, "-", "Longest gradient; longer ones are shortened.", gt=0)
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

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> Agent:
        """The agent of a training configuration, which holds this component."""
        from steersman.learning.ppo import make_ppo

        return make_ppo(config, env, self)

    def check(self, demonstration: Demonstration, steps: int) -> None:
        """No extra action: PPO weighs actions by the probability with which its policy took them.

        Raises:
            ConfigError: the demonstrator would act.
        """
        p = demonstration.p_action
        acts = any(p.value(steps * k / _LOOKS, steps) > 0.0 for k in range(_LOOKS + 1))
        if demonstration.enabled and acts:
            raise ConfigError(
                "ppo learns only from actions that its own policy chose, so the demonstrator "
                "cannot act (its reward works); switch the extra action off: "
                "problem.demonstration.p_action={kind: constant, at: 0}",
                ("problem", "demonstration", "p_action"),
            )

    @property
    def operators(self) -> tuple[str, str]:
        """ONNX operators after the policy's hidden layers and after its output."""
        return self.activation.capitalize(), "Clip"
