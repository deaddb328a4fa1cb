"""What every controller has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from steersman.config import dump, resolve
from steersman.contracts import Contract
from steersman.contracts.controller_faults import FAULTS, STEERED
from steersman.contracts.scenes import (
    CAR,
    DT,
    PosedRoad,
    after_executed,
    answers,
    beside,
    commands,
    drive,
    observe,
    plain,
    same,
    scenes,
    steering,
)
from steersman.controllers.base import ControllerComponent
from steersman.paths.analytic import Circle, Straight
from steersman.plants.simulator import SimulatorConfig
from steersman.policy_file import LEARNED
from steersman.sensing import WaypointSensor
from steersman.types import Observation, Status

_MOVED = PosedRoad(x=-350.0, y=120.0, psi=2.4)
_STRAIGHT, _BEND = Straight(), Circle()
# A command that has a sign; the share of places in which full lock is one of the unit.
_SIGN, _MOSTLY = 1e-3, 0.75
_NUMBERS = Observation._fields[:8]
_ANSWERED = {Status.SOLVED, Status.SATURATED}
# Differences that rounding makes; in single precision of one answer, and of a drive.
_CLOSE, _SINGLE, _SINGLE_DRIVEN = 1e-9, 1e-6, 1e-5


def _learned(data: Any) -> bool:
    """Whether there is a policy in a dumped controller, however deep."""
    if not isinstance(data, dict):
        return False
    return data.get("kind") in LEARNED or any(map(_learned, data.values()))


def _close(controller: ControllerComponent, driven: bool = False) -> float:
    if _learned(dump(controller)):  # a network computes in single precision
        return _SINGLE_DRIVEN if driven else _SINGLE
    return _CLOSE


def _differ(one: Any, other: Any, tolerance: float) -> bool:
    a, b = np.asarray(one, float), np.asarray(other, float)
    return a.shape != b.shape or not np.allclose(a, b, rtol=1e-6, atol=tolerance, equal_nan=True)


def _with(observation: Observation, name: str, value: float) -> Observation:
    """The observation with another value of one of its numbers."""
    return Observation(**{**observation._asdict(), name: value})


def a_loaded_controller_steers_alike(controller: ControllerComponent) -> Iterator[str]:
    """As plain data and back."""
    if not controller.kind:
        return
    again = resolve("controller", dump(controller))
    assert isinstance(again, ControllerComponent)
    if answers(again, scenes(PosedRoad())) != answers(controller, scenes(PosedRoad())):
        yield "made again from its plain data it steers otherwise"


def redesigned_it_steers_alike(controller: ControllerComponent) -> Iterator[str]:
    """``redesign`` leaves work for later, and changes nothing."""
    seen = scenes(PosedRoad())
    if answers(controller, seen, controller.redesign(CAR, DT)) != answers(controller, seen):
        yield "from the state of redesign it steers otherwise than from that of init"


def signs_are_those_of_iso_8855(controller: ControllerComponent) -> Iterator[str]:
    """Left of a road, or turned to its left, it steers right; round a left bend, left.

    A network may have learned otherwise, by which its drives are judged.
    """
    if _learned(dump(controller)):
        return
    for words, d, heading in (
        ("0.5 m left of", 0.5, 0.0),
        ("turned 0.1 rad to the left of", 0, 0.1),
    ):
        state = beside(_STRAIGHT, 50.0, d=d, heading=heading)
        steer = steering(controller, [observe(_STRAIGHT, state, 50.0)])[0]
        if steer > _SIGN:
            yield (
                f"{words} a straight road it steers left ({steer:.2g}): left is positive, in errors"
                " as in steering, so feedback has a minus"
            )
    bend = steering(controller, [observe(_BEND, beside(_BEND, 20.0), 20.0)])[0]
    if bend < -_SIGN:
        yield f"on the line of a left bend it steers right ({bend:.2g}); curvature is > 0 there"


def an_ordinary_place_asks_for_no_full_lock(controller: ControllerComponent) -> Iterator[str]:
    """Where commands are at the limit nearly everywhere, their unit is another one."""
    locked = _locked(controller)
    if locked >= _MOSTLY:
        yield (
            f"steers to the limit in {locked:.0%} of ordinary places: a gain is too large, or an"
            " angle is in degrees, where rad are meant"
        )


def _locked(controller: ControllerComponent) -> float:
    """Share of ordinary places where the command is at the limit."""
    return float(np.mean(np.abs(steering(controller, scenes(PosedRoad()))) >= 1.0))


def a_mirrored_observation_gives_negated_steering(
    controller: ControllerComponent,
) -> Iterator[str]:
    """Left and right are alike."""
    left = steering(controller, scenes(PosedRoad()))
    right = steering(controller, scenes(PosedRoad(side=-1.0), side=-1.0))
    if _differ(left, [-u for u in right], _close(controller)):
        yield "left and right are not steered alike"
    if max(map(abs, left)) <= 1e-3:  # noqa: PLR2004 - as good as none
        yield "steers nothing"


def a_mirrored_circle_gives_a_mirrored_drive(controller: ControllerComponent) -> Iterator[str]:
    """The closed loop is symmetric, too."""
    left = drive(controller, Circle(direction="left"), duration=4.0)
    right = drive(controller, Circle(direction="right"), duration=4.0)
    if left.end != right.end:
        yield f"ends by {left.end} to the left and by {right.end} to the right"
        return
    for name in ("lateral_error", "heading_error", "steer_command", "yaw_rate"):
        if _differ(left[name], -right[name], _close(controller, driven=True)):
            yield f"{name} differs between the left and the right circle"


def place_and_direction_do_not_matter(controller: ControllerComponent) -> Iterator[str]:
    """The same road elsewhere is steered equally, in the open and in the closed loop."""
    here, there = (steering(controller, scenes(road)) for road in (PosedRoad(), _MOVED))
    if _differ(here, there, _close(controller)):
        yield "steers otherwise on the same road elsewhere"
    if _locked(controller) >= _MOSTLY:  # it makes any rounding as large as the limit
        return
    one, other = (drive(controller, road, duration=6.0) for road in (PosedRoad(), _MOVED))
    if one.end != other.end:
        yield f"ends by {one.end} here and by {other.end} elsewhere"
        return
    for name in ("s", "lateral_error", "heading_error", "course_error", "steer_command", "v_x"):
        if _differ(one[name], other[name], _close(controller, driven=True)):
            yield f"{name} differs on the same road elsewhere"


def limits_are_kept(controller: ControllerComponent) -> Iterator[str]:
    """Far from the path and at any heading, too."""
    rng, path = np.random.default_rng(1), PosedRoad()
    row = [
        observe(path, beside(path, 30.0, d=d, heading=h, velocity=(v, 0.0)), 30.0)
        for d, h, v in rng.uniform((-20.0, -3.0, 0.0), (20.0, 3.0, 60.0), (60, 3)).tolist()
    ]
    worst = max(map(abs, steering(controller, row)))
    if not worst <= 1.0:
        yield f"commands {worst}"


def the_same_seed_gives_the_same_episode(controller: ControllerComponent) -> Iterator[str]:
    """To the bit; and another seed another one."""
    noisy = WaypointSensor(error_range=0.1)
    one, again, other = (
        drive(controller, PosedRoad(), sensor=noisy, seed=seed, duration=4.0) for seed in (5, 5, 6)
    )
    if not same(one, again):
        yield "two drives with one seed differ"
    if same(one, other):
        yield "drives with two seeds are equal, although the sensor's errors differ"


def one_object_drives_two_cars(controller: ControllerComponent) -> Iterator[str]:
    """What changes is in the state alone: two cars in turn are steered as each alone."""
    rows = scenes(PosedRoad()), scenes(PosedRoad(side=-1.0), side=0.5)
    alone = [answers(controller, row) for row in rows]
    states = [controller.init(CAR, DT) for _ in rows]
    together: list[list[Any]] = [[], []]
    for pair in zip(*rows, strict=True):
        for i, observation in enumerate(pair):
            decision, states[i] = controller.step(states[i], observation)
            together[i].append(decision)
    if together != alone:
        yield "two cars in turn are steered otherwise than each alone"


def a_state_is_left_alone(controller: ControllerComponent) -> Iterator[str]:
    """A first state serves many cars, and the same state gives the same answer twice."""
    fresh, row = controller.init(CAR, DT), scenes(PosedRoad())
    first = answers(controller, row, fresh)
    answers(controller, scenes(PosedRoad(side=-1.0), side=-1.0), fresh)
    if answers(controller, row, fresh) != first:
        yield "a first state that was used once gives other answers"
    state = controller.init(CAR, DT)
    for observation in row:
        once, after = controller.step(state, observation)
        if controller.step(state, observation)[0] != once:
            yield "the same state and observation give two answers"
        state = after


def an_observation_is_left_alone(controller: ControllerComponent) -> Iterator[str]:
    """Its array of waypoints is the sensor's."""
    observation = plain()
    kept = observation.preview.copy()
    controller.step(controller.init(CAR, DT), observation)
    if not np.array_equal(observation.preview, kept):
        yield "changes the observation's preview"


def the_executed_command_counts(controller: ControllerComponent) -> Iterator[str]:
    """Its own command changes nothing, the last one counts, and the state is left alone."""
    row = scenes(PosedRoad())
    alone = steering(controller, row)
    if after_executed(controller, row, alone) != alone:
        yield "its own command, passed to executed(), changes its steering"
    once = after_executed(controller, row, commands())
    twice = after_executed(controller, row, commands(1), commands())
    if _differ(once, twice, _close(controller)):
        yield "of two commands passed to executed() not the last one counts"
    state = controller.init(CAR, DT)
    for observation, steer, expected in zip(row, commands(), alone, strict=True):
        decision, state = controller.step(state, observation)
        controller.step(controller.executed(state, steer), observation)
        if decision.steer != expected:
            yield "executed() changes the state that it was given"
            return
    fresh = controller.init(CAR, DT)
    told = controller.executed(fresh, 0.0)
    if controller.step(told, plain())[0] != controller.step(fresh, plain())[0]:
        yield "executed() before the first step changes the first answer"


def mirrored_executed_commands_give_negated_steering(
    controller: ControllerComponent,
) -> Iterator[str]:
    """Left and right are alike there, too."""
    left = after_executed(controller, scenes(PosedRoad()), commands())
    mirrored = scenes(PosedRoad(side=-1.0), side=-1.0), [-u for u in commands()]
    if _differ(left, [-u for u in after_executed(controller, *mirrored)], _close(controller)):
        yield "after mirrored commands, passed to executed(), left and right differ"


def search_ranges_hold_the_defaults(controller: ControllerComponent) -> Iterator[str]:
    """What ``steersman tune`` may change lies around what it starts from."""
    for name, (low, high, log) in controller.search.items():
        value: Any = type(controller)()
        for part in name.split("."):
            value = getattr(value, part)
        if not low <= value <= high or not low < high:
            yield f"search {name}: {low:g} to {high:g} does not hold the default {value:g}"
        if log and not low > 0.0:
            yield f"search {name}: logarithmic from {low:g}, which is not greater than 0"


def other_control_periods_work(controller: ControllerComponent) -> Iterator[str]:
    """A hundredth and a tenth of a second; a policy belongs to the period of its training."""
    for dt in () if _learned(dump(controller)) else (0.01, 0.1):
        episode = drive(controller, PosedRoad(), plant=SimulatorConfig(dt=dt), duration=2.0)
        if len(episode) != round(2.0 / dt):
            yield f"dt {dt:g} s: ends after {len(episode) * dt:.2f} s by {episode.end}"


NOT_OF_NETWORKS = (
    *STEERED,
    a_mirrored_observation_gives_negated_steering,
    a_mirrored_circle_gives_a_mirrored_drive,
    mirrored_executed_commands_give_negated_steering,
)
check: Contract[ControllerComponent] = Contract(
    signs_are_those_of_iso_8855,
    an_ordinary_place_asks_for_no_full_lock,
    a_loaded_controller_steers_alike,
    redesigned_it_steers_alike,
    place_and_direction_do_not_matter,
    *FAULTS,
    limits_are_kept,
    the_same_seed_gives_the_same_episode,
    one_object_drives_two_cars,
    a_state_is_left_alone,
    an_observation_is_left_alone,
    the_executed_command_counts,
    search_ranges_hold_the_defaults,
    other_control_periods_work,
    also=lambda controller: () if _learned(dump(controller)) else NOT_OF_NETWORKS,
)
