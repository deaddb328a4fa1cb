"""The learning problem: car, roads, speeds, task and action, as one configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import field_validator, model_validator

from steersman.config import Of, Settings, dump, param
from steersman.controllers.adjustment import (
    Adjustment,
    adjustments,
    check_prices,
    flattened,
)
from steersman.controllers.base import ControllerComponent
from steersman.controllers.card import check_base
from steersman.disturbances import DisturbanceComponent, Disturber
from steersman.encoding import EncodingComponent, ExtendedEncoding, Layout
from steersman.errors import ConfigError
from steersman.faults import Fault
from steersman.features.base import Feature
from steersman.kernels.speed import SpeedTable
from steersman.kernels.step import Lesson
from steersman.lead import Lead
from steersman.learning.demonstration import Demonstration
from steersman.learning.rewards import RewardTerm
from steersman.learning.spread import Spread
from steersman.learning.task import PreciseTask, TaskComponent
from steersman.paths.base import PathComponent
from steersman.plants.base import PlantComponent
from steersman.plants.simulator import SimulatorConfig
from steersman.profiles import stack_profiles
from steersman.sensing import WaypointSensor
from steersman.speed import Nedc, SpeedComponent, SpeedTracking
from steersman.types import FloatArray
from steersman.vehicles import CarlaModel3, Vehicle

# Steering rate of the indirect action [1/s]; the paper's limit.
PAPER_RATE = 1.5708


# Actions that need a base.
_THROUGH = ("residual", "parameters")
# What of a spread only the embedded simulator can do.
CARS_DIFFER = (
    *("mass", "yaw_inertia", "stiffness", "friction", "slippery"),
    *("steer_rate", "steer_bias"),
)


class Problem(Settings):
    """What the agent has to learn."""

    vehicle: Annotated[Vehicle, Of("vehicle")] = param(CarlaModel3(), "-", "Vehicle.")
    nominal: Annotated[Vehicle | None, Of("vehicle", optional=True)] = param(
        None, "-", "Vehicle whose figures base and demonstrator get; null: the true one."
    )
    plant: Annotated[PlantComponent, Of("plant")] = param(SimulatorConfig(), "-", "Plant.")
    sensor: Annotated[WaypointSensor, Of("sensor")] = param(WaypointSensor(), "-", "Sensor.")
    fault: Fault | None = param(None, "-", "What breaks on the way; null: nothing.")
    disturbances: tuple[Annotated[DisturbanceComponent, Of("disturbance")], ...] = param(
        (), "-", "Further disturbances."
    )
    encoding: Annotated[EncodingComponent, Of("encoding")] = param(
        ExtendedEncoding(), "-", "Network input."
    )
    task: Annotated[TaskComponent, Of("task")] = param(PreciseTask(), "-", "Reward.")
    demonstration: Demonstration = param(Demonstration(), "-", "Demonstration.")
    action: Literal["rate", "direct", "residual", "parameters"] = param(
        "rate",
        "-",
        "The action is the steering rate (indirect), the steering (direct), what is added to the "
        "base's steering (residual), or the base's parameters.",
    )
    joint: bool = param(
        False,
        "-",
        "A second action is the speed: -1 standstill, 0 what the base allows (without a base the "
        "wished speed), 1 the wished speed, linear between.",
    )
    rate_limit: float = param(PAPER_RATE, "1/s", "Steering rate of action 1.", gt=0)
    base: Annotated[ControllerComponent | None, Of("controller", optional=True)] = param(
        None, "-", "Controller that steers under a residual action or under parameters."
    )
    authority: float = param(0.2, "-", "Correction of residual action 1.", gt=0, le=2)
    parameters: dict[str, str | tuple[Any, ...]] = param(
        {},
        "-",
        "Field of the base -> LOW..HIGH, LOW..HIGH:log, A|B or a list of values; one action each.",
    )
    prices: dict[str, float] = param(
        {}, "-", "Parameter -> what a unit of it costs in each control step, in units of reward."
    )
    period: int = param(1, "steps", "Control steps for which an action of parameters holds.", ge=1)
    roads: tuple[Annotated[PathComponent, Of("path")], ...] = param(
        ("training_circuit",), "-", "Roads to train on; each episode draws one."
    )
    speeds: tuple[Annotated[SpeedComponent, Of("speed")], ...] = param(
        (Nedc(a_lat_max=4.0),), "-", "Sources of speed; each episode draws one."
    )
    leads: tuple[Lead, ...] = param(
        (), "-", "Cars ahead; each episode draws one. None: there is no car ahead."
    )
    spread: Spread = param(Spread(), "-", "Differences between episodes.")
    start: Literal["start_area", "anywhere"] = param(
        "anywhere", "-", "Where episodes start: at s = 0, or at a random place."
    )
    episode_time: float = param(20.0, "s", "Length of an episode (truncation).", gt=0)
    corridor: float = param(1.5, "m", "Leaving it ends the episode.", gt=0)

    @field_validator("roads", "speeds", mode="before")
    @classmethod
    def _listed(cls, value: object) -> object:
        return value if isinstance(value, (list, tuple)) else (value,)

    @field_validator("roads", "speeds")
    @classmethod
    def _some(cls, value: tuple[object, ...]) -> tuple[object, ...]:
        if not value:
            raise ValueError("needs at least one")
        return value

    @field_validator("parameters", "prices", mode="before")
    @classmethod
    def _dotted(cls, value: Any) -> Any:
        return flattened(value) if isinstance(value, Mapping) else value

    @model_validator(mode="after")
    def _through_base(self) -> Problem:
        if self.action == "residual" and self.base is None:
            raise ValueError("action residual corrects a controller; name it as base")
        if self.action not in _THROUGH and self.base is not None:
            raise ValueError(
                f"base {self.base.kind!r} is given, but action {self.action!r} uses no base; "
                "set action=residual or action=parameters"
            )
        if self.base is not None:
            check_base(self.base, joint=self.joint)
        return self

    @model_validator(mode="after")
    def _adjusted(self) -> Problem:
        if self.action != "parameters":
            for name in ("parameters", "prices", "period"):
                if getattr(self, name) != type(self).model_fields[name].default:
                    raise ConfigError(
                        f"belongs to action parameters; action is {self.action}", (name,)
                    )
            return self
        if self.base is None or not self.parameters:
            raise ValueError(
                "action parameters sets fields of a controller; name it as base and its fields as "
                "parameters, such as parameters.q_heading=0.01..10:log"
            )
        check_prices(self.prices, adjustments(self.base, self.parameters))
        shown = self.demonstration
        if shown.enabled and shown.controller.kind != self.base.kind:
            raise ConfigError(
                f"{shown.controller.kind!r} has other parameters than the base "
                f"{self.base.kind!r}; name a controller of its kind, or set enabled=false",
                ("demonstration", "controller"),
            )
        return self

    @model_validator(mode="after")
    def _joined(self) -> Problem:
        """Speeds are for joint actions, and joint actions for speeds."""
        if self.joint and self.action == "parameters":
            raise ConfigError(
                "true is not allowed with action parameters, whose base drives as fast as wished",
                ("joint",),
            )
        held = next((one for one in self.speeds if not isinstance(one, SpeedTracking)), None)
        if self.joint and held is not None:
            raise ConfigError(
                f"{held.kind} wishes no speed, of which a joint action takes a share; name another "
                "one, or set joint=false",
                ("speeds",),
            )
        of_task: list[tuple[RewardTerm | Feature, str]] = [(t, "task") for t in self.task.terms]
        for one, where in (*of_task, *((f, "encoding") for f in self.layout.features)):
            if one.joint and not self.joint:
                needs = "the wished speed, which joint actions alone have; set joint=true"
                raise ConfigError(f"{one.kind} needs {needs}", (where,))
            if one.lead and not self.leads:
                needs = "a car ahead; name some as leads, such as leads=[{speed: nedc}]"
                raise ConfigError(f"{one.kind} needs {needs}", (where,))
        if self.leads and not self.joint:
            what = "a car ahead needs an action that changes the speed; set joint=true"
            raise ConfigError(what, ("leads",))
        return self

    @model_validator(mode="after")
    def _one_road_speed(self) -> Problem:
        if len(self.speeds) > 1:
            for source in self.speeds:
                if isinstance(source, SpeedTracking) and source.along() is not None:
                    raise ValueError(
                        f"speeds: {source.kind} gives speeds along the path, which leaves no room "
                        "for other sources; give it alone"
                    )
        return self

    @model_validator(mode="after")
    def _preview(self) -> Problem:
        needed = self.layout.reads
        if needed > self.sensor.count:
            raise ValueError(
                f"encoding {dump(self.encoding)} reads {needed} waypoints, sensor.count is "
                f"{self.sensor.count}"
            )
        return self

    @model_validator(mode="after")
    def _car_as_it_is(self) -> Problem:
        """Only cars that are computed here differ."""
        for name in CARS_DIFFER:
            given = getattr(self.spread, name)
            if given > 0.0 and not self.plant.computed:
                raise ConfigError(
                    f"{given:g} is not allowed; plant={self.plant.kind} has the one car that it "
                    "has: 0 [-]",
                    ("spread", name),
                )
        return self

    def check_vehicles(self, count: int, where: tuple[str, ...]) -> None:
        """Refuse several vehicles for a plant that drives one.

        Raises:
            ConfigError: at ``where``, the option that gives ``count``.
        """
        if not self.plant.computed and count != 1:
            raise ConfigError(
                f"{count} is not allowed; plant={self.plant.kind} drives one vehicle: 1 [-]", where
            )

    @model_validator(mode="after")
    def _delay(self) -> Problem:
        longest = self.plant.steering_delay + self.spread.delay
        self.plant.model_copy(update={"steering_delay": longest}).delay_of(self.vehicle)
        return self

    @property
    def indirect(self) -> bool:
        """Whether the action is the steering rate."""
        return self.action == "rate"

    @property
    def corrected(self) -> ControllerComponent | None:
        """The base whose steering a residual action corrects."""
        return self.base if self.action == "residual" else None

    def adjustments(self) -> tuple[Adjustment, ...]:
        """The fields of the base that the actions set; none unless the action is parameters."""
        return () if self.base is None else adjustments(self.base, self.parameters)

    @property
    def turned(self) -> FloatArray:
        """(m,) factor on each action that gives that of the mirrored scene."""
        if self.parameters:
            return np.ones(len(self.parameters))
        return np.array([-1.0, 1.0] if self.joint else [-1.0])

    @property
    def layout(self) -> Layout:
        """Layout of the network's input."""
        spacing, dt = self.sensor.spacing, self.plant.dt
        return self.encoding.layout(spacing, dt, self.action, joint=self.joint)

    def lesson(self) -> Lesson:
        """Features, reward and meaning of the actions, as the kernels read them."""
        layout = self.layout
        return Lesson(
            encoding=layout.table,
            scale=layout.scale,
            reward=self.task.table(),
            rate_limit=self.rate_limit if self.indirect else 0.0,
            authority=0.0 if self.corrected is None else self.authority,
            period=self.period,
        )

    def demands(self, n: int) -> SpeedTable:
        """Demands of speed for ``n`` vehicles over all roads, wide enough for every source."""
        rng = np.random.default_rng(0)
        profiles = [s.draw(rng, self.episode_time) for s in self.speeds]
        widest = max(profiles, key=lambda p: len(p.times))
        capped = next((p for p in profiles if p.a_lat_max is not None or p.road), widest)
        speed = stack_profiles([capped, *([widest] * n)], list(self.roads))
        return speed._replace(
            rows=speed.rows[1:].copy(), times=speed.times[1:].copy(), speeds=speed.speeds[1:]
        )

    def disturbers(self, n: int) -> list[Disturber | None]:
        """What disturbs ``n`` vehicles beside sensor and plant."""
        more = () if self.fault is None else (self.fault,)
        return [one.make(n, 0) for one in (*self.disturbances, *more)]
