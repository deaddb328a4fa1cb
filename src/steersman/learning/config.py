"""What a training run is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

from pydantic import field_validator, model_validator

from steersman import presets
from steersman.config import Of, Settings, build, override, param, read_yaml
from steersman.errors import ConfigError, suggestion
from steersman.learning.algorithms.base import AgentComponent
from steersman.learning.algorithms.ddpg import Ddpg
from steersman.learning.problem import CARS_DIFFER, Problem
from steersman.learning.task import FunctionTerm, Judged
from steersman.paths.base import PathComponent
from steersman.paths.random_road import RandomRoad
from steersman.plants.base import has_one_car


class ValidationConfig(Settings):
    """A fixed set of drives, never trained on, that measures the policy."""

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
    keep: bool = param(
        False, "-", "Keep every step as a Minari dataset in DIR/data (extra minari)."
    )
    threads: int = param(1, "-", "Threads of the linear algebra; more may change last bits.", ge=1)

    @model_validator(mode="after")
    def _fitting(self) -> TrainConfig:
        self.agent.check(self.problem.demonstration, self.steps)
        return self

    @model_validator(mode="after")
    def _one_car(self) -> TrainConfig:
        plant, vehicles = self.problem.plant, self.agent.vehicles
        if not plant.embedded and vehicles != 1:
            raise ConfigError(
                f"{vehicles} is not allowed; plant={plant.kind} drives one vehicle: 1 [-]",
                ("agent", "vehicles"),
            )
        return self

    def rewarded(self, function: Callable[[Judged], float]) -> TrainConfig:
        """The same training with a Python function as a further term of the reward."""
        task = self.problem.task
        terms = (*task.terms, FunctionTerm(function=function))
        changed = {"task": task.model_copy(update={"terms": terms})}
        return self.model_copy(update={"problem": self.problem.model_copy(update=changed)})


def train_config(data: Mapping[str, Any]) -> TrainConfig:
    """A training configuration from plain data, defaults filled in.

    Raises:
        ConfigError: it names something unknown or holds values that are not allowed.
    """
    return build(TrainConfig, data)


def load_preset(name: str) -> dict[str, Any]:
    """A shipped preset as plain data.

    Raises:
        ConfigError: there is no preset of that name.
    """
    file = presets.locate(name)
    if file is None:
        raise ConfigError(f"unknown preset {name!r}{suggestion(name, presets.names())}")
    return read_yaml(file)


# Drives of a validation where they come one after the other.
_FEW = 4


def for_one_car(tree: Mapping[str, Any], plant: Any) -> list[str]:
    """Assignments that make a training of many cars one of the one car of a plant.

    Updates stay as many for each step of a car, but one at least; the car is what it is.

    Args:
        tree: the training as plain data, which may be incomplete.
        plant: its plant, by name or by fields.

    Returns:
        What differs from ``tree``; nothing for the embedded simulator.
    """
    if not has_one_car(plant):
        return []
    many = build(TrainConfig, override(tree, ["problem.plant=simulator"]))
    agent = many.agent
    wanted = {
        "agent.vehicles": (agent.vehicles, 1),
        **one_car(many.problem, many.validation),
    }
    updates = getattr(agent, "updates", 0)
    if updates > 0:
        wanted["agent.updates"] = (updates, max(round(updates / agent.vehicles), 1))
    return differing(wanted)


def one_car(problem: Problem, validation: ValidationConfig) -> dict[str, tuple[float, float]]:
    """What every way of learning has to change for one car: its present value, and the new one."""
    wanted: dict[str, tuple[float, float]] = {
        "validation.vehicles": (validation.vehicles, min(validation.vehicles, _FEW))
    }
    for name in CARS_DIFFER:
        wanted[f"problem.spread.{name}"] = (getattr(problem.spread, name), 0)
    return wanted


def differing(wanted: Mapping[str, tuple[float, float]]) -> list[str]:
    """Assignments of the new values, where they are not the present ones."""
    return [f"{key}={new}" for key, (old, new) in wanted.items() if old != new]
