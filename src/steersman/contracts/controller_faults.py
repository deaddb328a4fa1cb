"""What every controller has to do under faulty measurements, at standstill, on the wrong way."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from steersman.contracts.scenes import CAR, DT, PosedRoad, answers, beside, drive, observe, plain
from steersman.controllers.base import ControllerComponent
from steersman.controllers.plausible import MOST
from steersman.paths.analytic import Circle, Straight
from steersman.paths.base import Start
from steersman.speed import ConstantSpeed, StopAndGo
from steersman.types import Observation, Status

_ANSWERED = {Status.SOLVED, Status.SATURATED}
# Outliers that a sensor may give; a single observation cannot be told from a true one.
_OUTLIERS = {
    "lateral_error": 5.0,
    "heading_error": 1.0,
    "v_x": 20.0,
    "v_y": 5.0,
    "yaw_rate": 2.0,
    "steer": 1.0,
}
# Steps before and after an outlier, and how far the steering may then be from that without it.
_BEFORE, _AFTER, _LEFT = 3, 10, 0.1
# Steps for which a car stands, and what is nearly full lock.
_STANDS, _LOCK = 60, 0.9
# Speed on the wrong way [m/s], and the time to turn round [s].
_SLOW, _TURN = 5.0, 20.0
# Time for which a car drives on after it stood [s].
_DRIVES = 6.0


def _with(observation: Observation, name: str, value: float) -> Observation:
    """The observation with another value of one of its numbers."""
    return observation._replace(**{name: value})  # type: ignore[arg-type] # a number, by its name


def input_that_no_car_measures_is_a_marked_fallback(
    controller: ControllerComponent,
) -> Iterator[str]:
    """The present steering is answered, and the next observation as if nothing had been."""
    good, points = plain(), plain().preview.copy()
    fresh = controller.step(controller.init(CAR, DT), good)[0]
    for value in (math.nan, math.inf, -math.inf, 1e4, -1e300):
        points[7, 1] = value
        names: tuple[str, ...] = ("time", *MOST, "spacing")
        if math.isfinite(value):  # such a time is late, such a heading was not wrapped
            names = tuple(name for name in MOST if name != "heading_error")
        bad = {name: _with(good, name, value) for name in names}
        for name, seen in {**bad, "preview": good._replace(preview=points.copy())}.items():
            decision, after = controller.step(controller.init(CAR, DT), seen)
            if decision.status is not Status.FALLBACK:
                yield f"{name} {value}: not marked as a fallback"
            held = min(max(seen.steer, -1.0), 1.0) if math.isfinite(seen.steer) else 0.0
            if decision.steer != held:
                yield f"{name} {value}: not answered by the present steering"
            if controller.step(after, good)[0] != fresh:
                yield f"{name} {value}: changes the next answer"


def any_finite_input_gives_a_command(controller: ControllerComponent) -> Iterator[str]:
    """However large, small or odd."""
    good, points = plain(), plain().preview
    for size in (1e-300, 1.0, 1e3, 1e9, 1e100, 1e300, 1.797e308):
        with np.errstate(over="ignore"):
            row = [good._replace(preview=s * size * points) for s in (1.0, -1.0)]
        row += [_with(good, f, s * size) for f in MOST for s in (1, -1)]
        row += [good._replace(v_x=v, v_y=0.0) for v in (0.0, -5.0, 200.0)]
        row += [good._replace(spacing=s) for s in (0.0, -1.0)]
        for decision in answers(controller, row):
            if not -1.0 <= decision.steer <= 1.0:
                yield f"answers {decision.steer} to input of the size {size:g}"


def one_outlier_costs_one_step(controller: ControllerComponent) -> Iterator[str]:
    """It may be answered by anything within the limits, but soon after nothing is left of it."""
    good = _driving_on(_BEFORE + 1 + _AFTER)
    usual = answers(controller, good)[-1].steer
    sizes: dict[str, tuple[float, ...]] = {n: (v, -v) for n, v in _OUTLIERS.items()}
    sizes["heading_error"] += (1e3, 1e100, 1e300)
    for name, values in sizes.items():
        for value in values:
            row = [*good[:_BEFORE], _with(good[_BEFORE], name, value), *good[_BEFORE + 1 :]]
            last = answers(controller, row)[-1].steer
            if abs(last - usual) > _LEFT:
                yield f"{_AFTER} steps after {name} = {value:g}: {last:.2f} instead of {usual:.2f}"


def _driving_on(count: int) -> list[Observation]:
    """A car 0.1 m beside a circle at 10 m/s: a filter takes what does not move for lost samples."""
    path, v, d = Circle(radius=50.0), 10.0, 0.1
    kappa = path.at(0.0).curvature
    seen = []
    for i in range(count):
        s, velocity = 10.0 + v * DT * i, (v * (1.0 - kappa * d), 0.0)
        car = beside(path, s, d=d, velocity=velocity, yaw_rate=v * kappa, time=DT * i)
        seen.append(observe(path, car, s))
    return seen


def whole_turns_of_the_heading_do_not_matter(controller: ControllerComponent) -> Iterator[str]:
    """A heading error that was not wrapped is steered like the wrapped one, or is a fallback."""
    good = plain()
    for turns in (1, -1, 2):
        seen = good._replace(heading_error=good.heading_error + turns * math.tau)
        one, other = (answers(controller, [o])[0] for o in (good, seen))
        if other.status is not Status.FALLBACK and abs(one.steer - other.steer) > 1e-6:  # noqa: PLR2004
            yield f"steers {other.steer:.3f} instead of {one.steer:.3f} after {turns} turns"


def a_standing_car_gets_an_ordinary_answer(controller: ControllerComponent) -> Iterator[str]:
    """No division by the speed."""
    path = PosedRoad()
    cars = [beside(path, 30.0, d=d, heading=0.05, velocity=(0.0, 0.0)) for d in (0.0, 0.3, -0.3)]
    for decision in answers(controller, [observe(path, car, 30.0) for car in cars]):
        if decision.status not in _ANSWERED:
            yield "answers a standing car by a fallback"


def a_car_that_stands_beside_the_road_keeps_its_wheels_still(
    controller: ControllerComponent,
) -> Iterator[str]:
    """Neither full lock nor any change, for as long as it stands."""
    path = Straight(distance=200.0)
    for d in (0.5, -0.5):
        state, steer, row = controller.init(CAR, DT), 0.0, []
        for i in range(_STANDS):
            car = beside(path, 30.0, d=d, velocity=(0.0, 0.0), steer=steer, time=i * DT)
            decision, state = controller.step(state, observe(path, car, 30.0))
            steer = decision.steer
            row.append(steer)
        if max(map(abs, row)) > _LOCK:
            yield f"steers {max(row, key=abs):.2f} while it stands {d:g} m beside the road"
        late = row[_STANDS // 2 :]
        if max(late) - min(late) > 1e-2:  # noqa: PLR2004 - one percent of full lock
            yield f"moves the wheels from {min(late):.3f} to {max(late):.3f} while the car stands"


def the_time_at_standstill_does_not_matter(controller: ControllerComponent) -> Iterator[str]:
    """Nothing is wound up while the car stands beside the road: it drives on alike."""
    moving = round(_DRIVES / DT)
    short, long = (
        drive(
            controller,
            Straight(distance=200.0),
            speed=StopAndGo(speed=_SLOW, stand=stand),
            start=Start(s=5.0, offset=0.3),
            corridor=10.0,
            duration=stand + _DRIVES,
        )["lateral_error"][-moving:]
        for stand in (1.0, 21.0)
    )
    most = float(np.abs(short - long).max()) if short.shape == long.shape else math.inf
    if most > 0.02:  # noqa: PLR2004 - two centimetres
        yield f"after standing for 21 s instead of 1 s it drives {most:.2f} m beside its other way"


def driving_backwards_is_steered_rightly_or_a_fallback(
    controller: ControllerComponent,
) -> Iterator[str]:
    """A car in reverse turns to the other side."""
    path = PosedRoad()
    for heading in (0.2, -0.2):
        one, other = (
            answers(
                controller,
                [observe(path, beside(path, 5.0, heading=heading, velocity=(v, 0.0)), 5.0)],
            )[0]
            for v in (3.0, -3.0)
        )
        if other.status is not Status.FALLBACK and one.steer * other.steer >= 0.0:
            yield f"in reverse it steers {other.steer:.2f}, as forwards, at a heading of {heading}"


def the_wrong_way_is_turned_round_or_a_fallback(controller: ControllerComponent) -> Iterator[str]:
    """A car that drives against the road's direction turns round, or is answered by a fallback."""
    road = Straight(distance=400.0)
    for degrees in (150.0, -150.0, 179.0):
        start = Start(s=200.0, offset=0.2, heading=math.radians(degrees))
        episode = drive(
            controller, road, speed=ConstantSpeed(speed=_SLOW), start=start, corridor=50.0,
            duration=_TURN,
        )  # fmt: skip
        heading = abs(math.remainder(float(episode["heading_error"][-1]), math.tau))
        marked = episode["status"][-1] == Status.FALLBACK
        if heading > 0.5 * math.pi and not marked:
            yield f"from {degrees:g} degrees on it drives the road the wrong way"


FAULTS = (
    input_that_no_car_measures_is_a_marked_fallback,
    any_finite_input_gives_a_command,
    whole_turns_of_the_heading_do_not_matter,
    a_standing_car_gets_an_ordinary_answer,
    driving_backwards_is_steered_rightly_or_a_fallback,
    the_wrong_way_is_turned_round_or_a_fallback,
)
STEERED = (
    one_outlier_costs_one_step,
    the_time_at_standstill_does_not_matter,
    a_car_that_stands_beside_the_road_keeps_its_wheels_still,
)
"""What an untrained network need not fulfil."""
