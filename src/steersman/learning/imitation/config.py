"""What an imitation is made of."""

from __future__ import annotations

import math
from typing import Annotated, Literal, TypeAlias

from pydantic import field_validator, model_validator

from steersman.config import Of, Settings, param
from steersman.errors import ConfigError
from steersman.learning.config import TRIM, TrainConfig, ValidationConfig
from steersman.learning.problem import Problem
from steersman.learning.schedules import Constant, HoldThenDecay, Schedule


class FitConfig(Settings):
    """A network fitted to actions by least squares: mini-batches, Adam."""

    hidden: tuple[int, int] = param((128, 128), "-", "Units of the two hidden layers.")
    updates: int = param(100_000, "-", "Updates, spread evenly over the rounds.", ge=1)
    batch: int = param(256, "-", "Samples in a batch.", ge=1)
    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        HoldThenDecay(start=1e-3, end=1e-5, hold=0.3), "-", "Learning rate over the updates."
    )
    huber: float | None = param(
        None, "-", "Errors of the action beyond this count linearly; null: all squared.", gt=0
    )
    mirror: bool = param(
        True, "-", "Learn from mirror images, left for right, in half of each batch."
    )


class ImitationConfig(Settings):
    """A network that imitates ``problem.demonstration.controller``, by rounds.

    In each round the vehicles drive, every step is labelled with the demonstrator's action, and
    the network is fitted to all samples so far. bc: the demonstrator drives. dagger: from the
    second round on the network drives, but for a share ``beta`` of the steps.
    """

    problem: Problem = param(Problem(), "-", "Roads, cars, input, action, and the demonstrator.")
    method: Literal["dagger", "bc"] = param("dagger", "-", "DAgger or behaviour cloning.")
    data: tuple[str, ...] = param(
        (),
        "-",
        "bc: Minari datasets, ROS 2 recordings or episodes to learn from, instead of driving.",
    )
    label: Literal["demonstrated", "executed"] = param(
        "demonstrated",
        "-",
        "data: learn the demonstrator's action where there is one, or what was executed.",
    )
    ahead: float = param(
        0.0,
        "m",
        "data: centre of mass ahead of what recordings' Odometry describes; l_r for the rear axle.",
        ge=-20.0,
        le=20.0,
    )
    rounds: int = param(10, "-", "Rounds of driving and fitting.", ge=1, le=1000)
    steps: int = param(
        200_000, "steps", "Environment steps of all vehicles together, over all rounds.", gt=0
    )
    vehicles: int = param(16, "-", "Vehicles that drive at the same time.", ge=1, le=1024)
    beta: Annotated[Schedule, Of("schedule")] = param(
        Constant(at=0.0), "-", "dagger: share of steps the demonstrator drives after round one."
    )
    noise: Annotated[Schedule, Of("schedule")] = param(
        Constant(at=0.0), "-", "sigma of the noise on what is executed, of the action's range."
    )
    noise_theta: float = param(0.15, "-", "Return of the noise to zero per step.", gt=0, le=1)
    fit: FitConfig = param(FitConfig(), "-", "Network and fit.")
    validation: ValidationConfig = param(
        ValidationConfig(), "-", "Validation, after every round (interval is not used)."
    )
    seed: int = param(0, "-", "Seed of everything random.", ge=0)
    trim: float = TRIM
    threads: int = param(1, "-", "Threads of the linear algebra; more may change last bits.", ge=1)

    @field_validator("data", mode="before")
    @classmethod
    def _listed(cls, value: object) -> object:
        return (value,) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _given(self) -> ImitationConfig:
        if self.data and self.method != "bc":
            raise ConfigError(
                f"learning from data is behaviour cloning, without any driving; set method=bc, not "
                f"{self.method}",
                ("data",),
            )
        return self

    @model_validator(mode="after")
    def _rounds(self) -> ImitationConfig:
        self.problem.check_vehicles(self.vehicles, ("vehicles",))
        if not self.problem.demonstration.enabled and not self.data:
            raise ValueError("problem.demonstration.enabled is false; set it to true, or name data")
        if self.steps < self.rounds * self.vehicles:
            raise ValueError(
                f"{self.rounds} rounds of {self.vehicles} vehicles need at least "
                f"{self.rounds * self.vehicles} steps, steps is {self.steps}"
            )
        if self.fit.updates < self.rounds:
            raise ValueError(
                f"{self.rounds} rounds need at least as many updates, "
                f"fit.updates is {self.fit.updates}"
            )
        return self

    def one_car(self) -> dict[str, tuple[int, int]]:
        """Options that depend on the number of cars: the present value, and that for one car."""
        return {"vehicles": (self.vehicles, 1)}

    @property
    def round_steps(self) -> int:
        """Control steps of each vehicle in a round."""
        return math.ceil(self.steps / (self.rounds * self.vehicles))


LearningConfig: TypeAlias = TrainConfig | ImitationConfig
