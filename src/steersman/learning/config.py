"""What a training run is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import field_validator, model_validator

from steersman import presets
from steersman.config import Of, Settings, build, merge, override, param, read_yaml
from steersman.errors import ConfigError, shortened, suggestion
from steersman.learning.algorithms.base import AgentComponent
from steersman.learning.algorithms.ddpg import Ddpg
from steersman.learning.problem import CARS_DIFFER, Problem
from steersman.learning.rewards import FunctionTerm, Judged
from steersman.learning.schedules import Schedule
from steersman.paths.base import PathComponent
from steersman.paths.random_road import RandomRoad
from steersman.plants.base import has_one_car

if TYPE_CHECKING:
    from steersman.learning.imitation.config import ImitationConfig

# Drives of a validation where they come one after the other.
_FEW = 4
TRIM: Any = param(
    0.0,
    "1/s",
    "Rate of the integral loop around the exported policy; training is without it.",
    ge=0,
    le=10,
)


class ValidationConfig(Settings):
    """A fixed set of drives, never trained on, that measures the policy."""

    roads: tuple[Annotated[PathComponent, Of("path")], ...] = param(
        tuple(RandomRoad(seed=1000 + i) for i in range(8)), "-", "Roads."
    )
    vehicles: int = param(32, "-", "Drives.", ge=1)
    interval: int = param(10_000, "steps", "Environment steps between validations.", gt=0)
    seed: int = param(12345, "-", "Seed of starts, speeds, cars and sensor errors.", ge=0)
    select: Literal["typical", "rms", "reward"] = param(
        "typical",
        "-",
        "The best policy by the geometric mean of the drives' mean errors, by the RMS error, or by "
        "the mean reward of a step; one that was not driven has the least of all, at most 0.",
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
    attenuation: Annotated[Schedule | None, Of("schedule", optional=True)] = param(
        None, "-", "Share of the base's steering over the training, clipped to 0 to 1; null: 1."
    )
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
    trim: float = TRIM
    keep: bool = param(
        False, "-", "Keep every step as a Minari dataset in DIR/data (extra minari)."
    )
    threads: int = param(1, "-", "Threads of the linear algebra; more may change last bits.", ge=1)

    @model_validator(mode="after")
    def _fitting(self) -> TrainConfig:
        self.agent.check(self.problem.demonstration, self.steps)
        if len(self.problem.turned) > 1 and not self.agent.joint:
            raise ConfigError(
                f"agent {self.agent.kind} learns one action, not {len(self.problem.turned)}; name "
                "ddpg, td3, sac or ppo",
                ("problem", "joint" if self.problem.joint else "parameters"),
            )
        if self.keep and self.problem.joint:
            raise ConfigError("datasets hold no wished speeds; set keep=false", ("keep",))
        if self.keep and self.problem.period > 1:
            raise ConfigError(
                "keeps every control step, but an action holds for problem.period = "
                f"{self.problem.period}; set keep=false or problem.period=1",
                ("keep",),
            )
        return self

    @model_validator(mode="after")
    def _attenuated(self) -> TrainConfig:
        """The features of drives that are kept or recorded do not know the share."""
        warm = self.problem.demonstration.warm_start
        for wrong, what in (
            (
                self.problem.corrected is None,
                "there is no base to attenuate; set problem.action=residual",
            ),
            (self.keep, "drives with a changing share cannot be kept; set keep=false"),
            (warm is not None and warm.data, "recorded data have all of the base; leave out data"),
        ):
            if self.attenuation is not None and wrong:
                raise ConfigError(what, ("attenuation",))
        return self

    @model_validator(mode="after")
    def _one_vehicle(self) -> TrainConfig:
        self.problem.check_vehicles(self.agent.vehicles, ("agent", "vehicles"))
        return self

    def base_share(self, step: float) -> float:
        """Share of the base's steering at an environment step."""
        fading = self.attenuation
        return 1.0 if fading is None else min(max(fading.value(step, self.steps), 0.0), 1.0)

    def one_car(self) -> dict[str, tuple[int, int]]:
        """Options that depend on the number of cars: the present value, and that for one car.

        Updates stay as many for each step of a car, but one at least.
        """
        cars, updates = self.agent.vehicles, getattr(self.agent, "updates", 0)
        fewer = max(round(updates / cars), 1) if updates else 0
        return {"agent.vehicles": (cars, 1), "agent.updates": (updates, fewer)}

    def rewarded(self, function: Callable[[Judged], float]) -> TrainConfig:
        """The same training with a Python function as a further term of the reward.

        Raises:
            ConfigError: it is no function.
        """
        given: Any = function
        if not callable(given):
            what = f"one function is needed, not {shortened(repr(given))}"
            raise ConfigError(what, ("reward",))
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


def read_preset(file: FilePath) -> dict[str, Any]:
    """A YAML file; ``like: NAME`` in it lays it over the preset of that name.

    Raises:
        DataError: the file is missing, or holds no mapping.
        ConfigError: there is no such preset.
    """
    tree = read_yaml(file)
    if "like" not in tree:
        return tree
    try:
        other = load_preset(str(tree.pop("like")))
    except ConfigError as error:
        raise ConfigError(error.what, ("like",)) from None
    return merge(other, tree)


def load_preset(name: str) -> dict[str, Any]:
    """A shipped preset as plain data.

    Raises:
        ConfigError: there is no preset of that name.
    """
    file = presets.locate(name)
    if file is None:
        raise ConfigError(f"unknown preset {name!r}{suggestion(name, presets.names())}")
    return read_preset(file)


def for_one_car(
    kind: type[TrainConfig] | type[ImitationConfig], tree: Mapping[str, Any], plant: Any
) -> list[str]:
    """Assignments that make a training or an imitation of many cars one of the one car of a plant.

    Args:
        kind: class of the configuration.
        tree: the configuration as plain data, which may be incomplete.
        plant: its plant, by name or by fields.

    Returns:
        What differs from ``tree``; nothing for the embedded simulator.
    """
    if not has_one_car(plant):
        return []
    many = build(kind, override(tree, ["problem.plant=simulator"]))
    validation, spread = many.validation, many.problem.spread
    changes = {
        **many.one_car(),
        "validation.vehicles": (validation.vehicles, min(validation.vehicles, _FEW)),
        **{f"problem.spread.{name}": (getattr(spread, name), 0) for name in CARS_DIFFER},
    }
    return [f"{key}={new}" for key, (old, new) in changes.items() if old != new]
