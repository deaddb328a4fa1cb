"""The suites ``acc`` and ``acc_tuning``: behind a car ahead, whose speed nothing tells beforehand.

The wished speed is higher than the car ahead drives but for short times, so that the gap is what
there is to control. ``acc`` has the driving cycle, stop and go, and eight drawn traces from calm
to hard braking; ``acc_tuning``, on which gains are tuned, has six others. Roads and traces of both
are used by no training.
"""

from __future__ import annotations

from steersman.bench.suite import Course, Suite
from steersman.lead import Lead
from steersman.paths.base import PathComponent
from steersman.paths.random_road import RandomRoad
from steersman.speed import ConstantSpeed, Nedc, RandomProfile, SpeedComponent, StopAndGo

_WISHED = ConstantSpeed(speed=33.0, a_lat_max=4.0)
_SECONDS, _TRACE = 90.0, 120.0
# Interval between breakpoints [s] and largest acceleration [m/s^2] of drawn traces, by its word.
_DRAWN = {"calm": (6.0, 1.0), "usual": (4.0, 2.0), "busy": (3.0, 3.0), "hard": (2.0, 6.0)}


def _road(seed: int, distance: float = 3500.0) -> RandomRoad:
    """A road of wide bends, longer than any drive."""
    return RandomRoad(
        seed=seed, distance=distance, min_radius=150.0, max_radius=600.0, min_clothoid=40.0,
        max_clothoid=100.0,
    )  # fmt: skip


def _behind(path: PathComponent, speed: SpeedComponent, seconds: float = _SECONDS) -> Course:
    return Course(path=path, speeds={"set": _WISHED}, duration=seconds, lead=Lead(speed=speed))


def _drawn(word: str, seed: int) -> RandomProfile:
    interval, change = _DRAWN[word]
    return RandomProfile(
        low=3.0, high=30.0, interval=interval, change=change, seed=seed, seconds=_TRACE
    )


def acc() -> Suite:
    """Ten traces of a car ahead."""
    courses = {
        f"{word}_{k}": _behind(_road(4000 + 2 * i + k), _drawn(word, 100 + k))
        for i, word in enumerate(_DRAWN)
        for k in range(2)
    }
    courses["nedc"] = _behind(_road(4010, 12000.0), Nedc(), 1180.0)
    stopping = StopAndGo(speed=14.0, stand=3.0, hold=8.0, change=2.5)
    courses["stop_and_go"] = _behind(_road(4011), stopping)
    return Suite(courses=courses)


def acc_tuning() -> Suite:
    """Six others."""
    courses = {
        f"{word}_tuned": _behind(_road(5000 + i), _drawn(word, 200))
        for i, word in enumerate(_DRAWN)
    }
    for name, speed in (("crawling", 5.0), ("stopping", 18.0)):
        stopping = StopAndGo(speed=speed, stand=4.0, hold=10.0, change=2.0)
        courses[name] = _behind(_road(5010), stopping)
    return Suite(courses=courses)
