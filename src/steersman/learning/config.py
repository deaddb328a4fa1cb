"""What a training run is made of."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import field_validator

from steersman.config import Of, Settings, param
from steersman.learning.problem import Problem
from steersman.learning.schedules import Constant, HoldThenDecay, Schedule
from steersman.paths.base import PathComponent
from steersman.paths.random_road import RandomRoad


class AgentConfig(Settings):
    """DDPG: networks, updates and exploration. Defaults are Stable-Baselines3's unless noted."""

    hidden: tuple[int, int] = param((128, 128), "-", "Units of the two hidden layers.")
    gamma: float = param(0.95, "-", "Discount per control step.", gt=0, lt=1)
    tau: float = param(0.005, "-", "Share by which targets follow at each update.", gt=0, le=1)
    batch: int = param(256, "-", "Transitions in a batch.", ge=1)
    buffer: int = param(300_000, "-", "Transitions in the replay buffer.", ge=1)
    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        HoldThenDecay(start=1e-3, end=2e-5, hold=0.5), "-", "Learning rate of both networks."
    )
    noise: Annotated[Schedule, Of("schedule")] = param(
        Constant(at=0.2), "-", "sigma of the Ornstein-Uhlenbeck noise, of the action range."
    )
    noise_theta: float = param(0.15, "-", "Return of the noise to zero per step.", gt=0, le=1)
    noise_dt: float = param(
        1.0, "-", "Time step of the noise; 0.01 is Stable-Baselines3's, slow and persistent.", gt=0
    )
    vehicles: int = param(16, "-", "Vehicles that collect at the same time.", ge=1, le=1024)
    updates: int = param(4, "-", "Updates after each step of all vehicles.", ge=0)
    mirror: bool = param(
        False, "-", "Learn from mirror images, left for right, in half of each batch."
    )
    learning_starts: int = param(2000, "steps", "Random actions before learning.", ge=0)


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
    agent: AgentConfig = param(AgentConfig(), "-", "The learning agent.")
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
