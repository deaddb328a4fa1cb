"""Suites as data: courses x speeds x disturbances x vehicles x seeds, and their scenarios."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np
from pydantic import field_validator, model_validator

from steersman.bench.disturbance import Disturbance, Mixed
from steersman.config import Of, Settings, param, required
from steersman.errors import ConfigError, suggestion
from steersman.estimators.base import EstimatorComponent, PredictorComponent
from steersman.lead import Lead
from steersman.paths.base import PathComponent, Start
from steersman.plants.base import PlantComponent
from steersman.plants.simulator import SimulatorConfig
from steersman.rollout import RunConfig
from steersman.speed import RandomProfile, SpeedComponent
from steersman.vehicles import CarlaModel3, Vehicle

CLEAN = "clean"

_Speed: TypeAlias = Annotated[SpeedComponent, Of("speed")]
_Car: TypeAlias = Annotated[Vehicle, Of("vehicle")]


class Course(Settings):
    """A path, and how it is driven."""

    path: Annotated[PathComponent, Of("path")] = required("-", "Path to follow.")
    speeds: dict[str, _Speed] = required("-", "Sources of speed by name.")
    duration: float | None = param(
        None, "s", "Length of a run; null with laps null: to the end of an open path.", gt=0
    )
    laps: float | None = param(None, "-", "Laps of a closed path, instead of a duration.", gt=0)
    start: float = param(0.0, "m", "Arc length at which runs start.", ge=0)
    only: dict[str, tuple[str, ...]] = param(
        {}, "-", "Disturbances by the name of a speed; a speed without them meets all."
    )
    vehicle: str | None = param(
        None, "-", "The one vehicle of the suite that drives here; null: each of them."
    )
    plant: Annotated[PlantComponent | None, Of("plant", optional=True)] = param(
        None, "-", "Plant; null: the suite's."
    )
    corridor: float | None = param(
        None, "m", "Half width of the corridor; null: the suite's.", gt=0
    )
    lead: Lead | None = param(None, "-", "A car ahead in the own lane; null: none.")


class Scenario(NamedTuple):
    """One run that every controller has to drive; ``run.controller`` is to be replaced."""

    path: str
    speed: str
    disturbance: str
    vehicle: str
    seed: int
    """The benchmark's seed, from which everything random in ``run`` follows."""
    applied: Disturbance
    run: RunConfig
    graded: bool = True
    """Whether what it asks of the grip decides where it is counted."""

    @property
    def name(self) -> str:
        """The words that tell it from all others of its suite."""
        return "/".join((self.path, self.speed, self.disturbance, self.vehicle, str(self.seed)))


class Suite(Settings):
    """Scenarios by their factors; every factor is crossed with every other."""

    courses: dict[str, Course] = required("-", "Paths with their speeds, by name.")
    disturbances: dict[str, Disturbance] = param(
        {CLEAN: Disturbance()}, "-", "Disturbances by name."
    )
    mixed: dict[str, Mixed] = param(
        {}, "-", "Disturbances that are drawn from the seed, by name; anew in each scenario."
    )
    vehicles: dict[str, _Car] = param({"carla_model3": CarlaModel3()}, "-", "Vehicles by name.")
    estimator: Annotated[EstimatorComponent | None, Of("estimator", optional=True)] = param(
        None, "-", "State estimator in front of every controller; null: none."
    )
    predictor: Annotated[PredictorComponent | None, Of("predictor", optional=True)] = param(
        None, "-", "Predictor in front of every controller, for delays; null: none."
    )
    corridor: float = param(1.5, "m", "Half width of the corridor; leaving it ends a run.", gt=0)
    plant: Annotated[PlantComponent, Of("plant")] = param(
        SimulatorConfig(), "-", "Plant; scenarios that it cannot do are left out, and counted."
    )
    graded: bool = param(
        True, "-", "Scenarios that ask an axle for more than 90 % of its grip are counted apart."
    )
    sample: int | None = param(
        None, "-", "So many scenarios of each disturbance, drawn from the seed; null: all.", ge=1
    )

    @field_validator("courses", "vehicles")
    @classmethod
    def _some(cls, value: dict[str, object]) -> dict[str, object]:
        if not value:
            raise ValueError("needs at least one")
        return value

    @model_validator(mode="after")
    def _names(self) -> Suite:
        twice = sorted(set(self.disturbances) & set(self.mixed))
        if twice:
            raise ConfigError(f"{twice[0]!r} is in disturbances too", ("mixed",))
        known = {**self.disturbances, **self.mixed}
        if not known:
            raise ConfigError("needs at least one", ("disturbances",))
        for name, course in self.courses.items():
            if course.vehicle not in {None, *self.vehicles}:
                near = suggestion(str(course.vehicle), self.vehicles)
                of = ("courses", name, "vehicle")
                raise ConfigError(f"unknown vehicle {course.vehicle!r}{near}", of)
            for speed, words in course.only.items():
                where = ("courses", name, "only", speed)
                if speed not in course.speeds:
                    raise ConfigError(f"unknown speed{suggestion(speed, course.speeds)}", where)
                for word in words:
                    if word not in known:
                        message = f"unknown disturbance {word!r}{suggestion(word, known)}"
                        raise ConfigError(message, where)
        return self

    def scenarios(self, seeds: Sequence[int] = (0,)) -> list[Scenario]:
        """Every scenario for every seed, in a fixed order.

        A drawn speed depends on seed and path alone, so that it is the same under every
        disturbance; what a mixed disturbance draws differs from scenario to scenario. Those that
        are beyond the plant are not among them.
        """
        every = self._every(seeds)
        return [one for one in every if not one.applied.beyond(one.run.plant)]

    def left_out(self, seeds: Sequence[int] = (0,)) -> dict[str, int]:
        """Scenarios that the plant cannot do, by the name of their disturbance."""
        every = self._every(seeds)
        return dict(Counter(one.disturbance for one in every if one.applied.beyond(one.run.plant)))

    def _every(self, seeds: Sequence[int]) -> list[Scenario]:
        return [self._scenario(*each, seed) for seed in seeds for each in self._drawn(seed)]

    def _drawn(self, seed: int) -> list[tuple[str, str, str, str]]:
        """Path, speed, disturbance and vehicle of all scenarios, or of a sample of them."""
        every = self._combined()
        if self.sample is None:
            return every
        kept = set()
        for disturbance in (*self.disturbances, *self.mixed):
            alike = [each for each in every if each[2] == disturbance]
            rng = np.random.default_rng(derived_seed(seed, "sample", disturbance))
            chosen = rng.permutation(len(alike))[: self.sample]
            kept |= {alike[k] for k in chosen}
        return [each for each in every if each in kept]

    def _combined(self) -> list[tuple[str, str, str, str]]:
        every = (*self.disturbances, *self.mixed)
        return [
            (path, speed, disturbance, vehicle)
            for path, course in self.courses.items()
            for speed in course.speeds
            for disturbance in course.only.get(speed, every)
            for vehicle in self.vehicles
            if course.vehicle in {None, vehicle}
        ]

    def _scenario(
        self, path: str, speed: str, disturbance: str, vehicle: str, seed: int
    ) -> Scenario:
        course = self.courses[path]
        source, lead = _redrawn(course.speeds[speed], seed, path, speed), course.lead
        if lead is not None:
            lead = lead.model_copy(update={"speed": _redrawn(lead.speed, seed, path, "lead")})
        own = derived_seed(seed, path, speed, disturbance, vehicle)
        applied = self.disturbances.get(disturbance)
        if applied is None:
            applied = self.mixed[disturbance].draw(np.random.default_rng([own, 1]))
        run = RunConfig(
            path=course.path,
            speed=source,
            vehicle=self.vehicles[vehicle],
            duration=course.duration,
            laps=course.laps,
            corridor=self.corridor if course.corridor is None else course.corridor,
            start=Start(s=course.start),
            plant=self.plant if course.plant is None else course.plant,
            lead=lead,
            estimator=self.estimator,
            predictor=self.predictor,
            seed=own,
        )
        driven = applied.apply(run)
        return Scenario(path, speed, disturbance, vehicle, seed, applied, driven, self.graded)


def _redrawn(source: SpeedComponent, seed: int, *words: str) -> SpeedComponent:
    """A drawn speed as it is drawn for a benchmark's seed."""
    if not isinstance(source, RandomProfile):
        return source
    return source.model_copy(update={"seed": derived_seed(seed, *words, str(source.seed))})


def derived_seed(seed: int, *words: str) -> int:
    """A seed below 2^31 that depends on ``seed`` and on every word.

    >>> derived_seed(0, "circle") == derived_seed(0, "circle") != derived_seed(1, "circle")
    True
    """
    text = "/".join((str(seed), *words))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big") >> 1
