"""What a training run is made of."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import field_validator, model_validator

from steersman.config import Of, Settings, param
from steersman.learning.algorithms import AgentComponent, Ddpg
from steersman.learning.problem import Problem
from steersman.paths.base import PathComponent
from steersman.paths.random_road import RandomRoad


class ValidationConfig(Settings):
    """A fixed set of drives, never trained on, that tells how good the policy is."""

    roads: tuple[Annotated[PathComponent, Of("path")], ...] = param(
        tuple(RandomRoad(seed=1000 + i) for i in range(8)), "-", "Roads."
    )
    vehicles: int = param(32, "-", "Drives.", ge=1)
    interval: int = param(10_000, "steps", "Environment steps between validations.", gt=0)
    seed: int = param(12345, "-", "Seed of starts, speeds, cars and sensor errors.", ge=0)
    select: Literal["typical", "rms"] = param(
        "typical",
        "-",
        "The best policy by the geometric mean of the drives' mean errors, or by the RMS error.",
    )
    steer_weight: float = param(
        0.0, "m", "Price of the RMS change of steering per step in the score.", ge=0
    )

    @field_validator("roads", mode="before")
    @classmethod
    def _listed(cls, value: object) -> object:
        return value if isinstance(value, (list, tuple)) else (value,)


class TrainConfig(Settings):
    """A training run."""

    problem: Problem = param(Problem(), "-", "What is to be learned.")
    agent: Annotated[AgentComponent, Of("agent")] = param(Ddpg(), "-", "The learning algorithm.")
    validation: ValidationConfig = param(ValidationConfig(), "-", "Validation.")
    steps: int = param(200_000, "steps", "Environment steps of all vehicles together.", gt=0)
    seed: int = param(0, "-", "Seed of everything random.", ge=0)
    checkpoint_interval: int = param(50_000, "steps", "Steps between checkpoints.", gt=0)
    average: float | None = param(
        None,
        "-",
        "Share of the steps after which the policy's weights are averaged; their mean is validated "
        "and exported. null: no averaging.",
        ge=0,
        lt=1,
    )
    trim: float = param(
        0.0,
        "1/s",
        "Rate of the integral loop around the exported policy; training is without it.",
        ge=0,
        le=10,
    )
    threads: int = param(1, "-", "Threads of the linear algebra; more may change last bits.", ge=1)

    @model_validator(mode="after")
    def _fitting(self) -> TrainConfig:
        self.agent.check(self.problem.demonstration, self.steps)
        return self
