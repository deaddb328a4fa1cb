"""Courses that suites have in common, and the speeds at which they are driven."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from steersman.bench.suite import CLEAN, Course
from steersman.paths.analytic import Circle, DoubleLaneChange, FigureEight, Lemniscate
from steersman.paths.base import PathComponent
from steersman.paths.tracks import Monza
from steersman.speed import ConstantSpeed, RandomProfile, SpeedComponent

Speeds: TypeAlias = dict[str, SpeedComponent]

# A car that slides or whose model is wrong can still hold this lateral acceleration [m/s^2].
CAP = 6.0
# ISO 3888-2 with a car of 2.16 m: lanes 1.1 b + 0.25 and b + 1, 1 m between them. Its changes of
# lane, 13.5 and 12.5 m, would need a radius of 6 to 7 m; stretched to 20 m it is 13.4 m.
_OBSTACLE = DoubleLaneChange(entry=12.0, out=20.0, beside=11.0, back=20.0, exit=12.0, offset=3.89)


def constant(speed: float, cap: float = CAP) -> ConstantSpeed:
    """A constant speed [m/s], less where it would exceed ``cap`` [m/s^2]."""
    return ConstantSpeed(speed=speed, a_lat_max=cap)


def changing(high: float, cap: float = CAP, seconds: float = 120.0) -> RandomProfile:
    """Speeds from 5 m/s to ``high`` that change by up to 2 m/s^2, drawn from the seed."""
    return RandomProfile(low=5.0, high=high, a_lat_max=cap, seconds=seconds)


def course(path: PathComponent, speed: float, high: float, **words: Any) -> Course:
    """A course at a constant speed and at changing ones up to ``high`` [m/s]."""
    speeds: Speeds = {"constant": constant(speed), "changing": changing(high)}
    return Course(path=path, speeds=speeds, **words)


def also(found: Course, name: str, speed: SpeedComponent, *disturbances: str) -> Course:
    """The course with one more speed, that meets these disturbances alone."""
    speeds: Speeds = {**found.speeds, name: speed}
    return found.model_copy(update={"speeds": speeds, "only": {**found.only, name: disturbances}})


def known_courses() -> dict[str, Course]:
    """What is no random road: circles, lemniscate, figure eight, lane changes, Monza."""
    monza: Speeds = {"constant": constant(20.0), "changing": changing(28.0, seconds=900.0)}
    return {
        "circle_50_left": course(Circle(), 15.0, 20.0, duration=30.0),
        "circle_50_right": course(Circle(direction="right"), 15.0, 20.0, duration=30.0),
        "circle_100_left": course(Circle(radius=100.0), 22.0, 25.0, duration=30.0),
        "lemniscate": course(Lemniscate(), 12.0, 20.0, duration=40.0),
        "figure_eight": course(FigureEight(), 11.0, 20.0, duration=40.0),
        "iso_3888_1": course(DoubleLaneChange(), 15.0, 20.0),
        "iso_3888_2": course(_OBSTACLE, 12.0, 18.0),
        "monza": Course(path=Monza(), speeds=monza, laps=1),
    }


def sporty(
    courses: Mapping[str, Course], speeds: Mapping[str, float], cap: float
) -> dict[str, Course]:
    """The courses, some with a clean run at a speed [m/s] and lateral acceleration ``cap``."""
    out = dict(courses)
    for name, speed in speeds.items():
        out[name] = also(out[name], "sporty", constant(speed, cap), CLEAN)
    return out
