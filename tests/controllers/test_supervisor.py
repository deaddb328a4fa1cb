"""The supervisor: what it sends whatever happens, when it takes over, and when it gives back."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steersman.bench.suites import suite
from steersman.config import build, override, resolve
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.controllers.dead_reckoning import STRAIGHTEN, held, moved_on, quiet, reckoned
from steersman.controllers.supervisor import Supervisor
from steersman.controllers.supervisor_checks import still
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.kernels import mpc_delay as kernel
from steersman.learning.snapshot import changed, read, rebuilt, write
from steersman.outcome import RunError
from steersman.paths.analytic import Circle, Straight
from steersman.plants.simulator import SimulatorConfig
from steersman.rollout import RunConfig, run
from steersman.sensing import WaypointSensor, track
from steersman.speed import ConstantSpeed
from steersman.types import Command, Decision, Driver, Observation, Pose, Reason, Status
from steersman.vehicles import CarlaModel3V1

from ..loops import CAR, DT, Posed, answers, beside, drive, observe, same, scenes

STEP = CAR.steer_rate_down * DT
GOOD = 0.05
NUMBERS = (math.nan, math.inf, -math.inf, 1e300, -7.0, 1.0, -1.0, 0.3, GOOD)
OTHERS = (None, "0.1", True, [0.1], np.array([0.1]), np.float32("nan"), 1j, "raise", "die")


class Scripted(Wrapper):
    """Returns what its script says, step by step, then ``GOOD``; its state counts the steps."""

    family: ClassVar[str] = "controller"
    kind: ClassVar[str] = "scripted"
    script: tuple[Any, ...] = ()
    tells: bool = False

    def init(self, vehicle: Any, dt: float) -> Iterator[int]:
        return count()  # changes itself, so that a restart does not begin anew

    def step(self, state: Iterator[int], observation: Observation) -> Any:
        k = next(state)
        answer = self.script[k] if k < len(self.script) else GOOD
        if isinstance(answer, str) and answer == "raise":
            raise ZeroDivisionError("in the controller")
        if isinstance(answer, str) and answer == "die":
            return None
        if isinstance(answer, Decision):
            return answer, state
        return Decision(answer), state

    def executed(self, state: Any, steer: float) -> Any:
        if self.tells:
            raise RuntimeError("told")
        return state


def supervised(inner: Any = None, **fields: Any) -> Supervisor:
    inner = Scripted() if inner is None else inner
    return Supervisor(**{"inner": inner, "fallback": "pid", "last": "pid", **fields})


def steady(n: int, d: float = 0.0) -> list[Observation]:
    """Along a circle of 50 m at 10 m/s, with little errors that change from step to step."""
    path = Circle()
    return [
        observe(path, beside(path, 0.5 * k, d=d + 1e-4 * k, yaw_rate=0.2, time=DT * k), 0.5 * k)
        for k in range(n)
    ]


def decisions(controller: Supervisor, observations: list[Any]) -> list[Decision]:
    state, out = controller.init(CAR, DT), []
    for observation in observations:
        decision, state = controller.step(state, observation)
        out.append(decision)
    return out


def drivers(controller: Supervisor, observations: list[Any]) -> list[Driver]:
    return [decision.driver for decision in decisions(controller, observations)]


def bad_observations() -> list[Any]:
    good = steady(1)[0]
    holes = good.preview.copy()
    holes[3, 0] = math.nan
    return [
        None,
        "observation",
        good._replace(v_x=math.nan),
        good._replace(yaw_rate=1e200),
        good._replace(lateral_error=-40.0),
        good._replace(preview=holes),
        good._replace(preview=1e5 * good.preview),
        good._replace(preview=good.preview[:, :1]),
        good._replace(preview=None),
        good._replace(heading_error="east"),
        good._replace(preview=good.preview[:3]),
        good._replace(preview=good.preview.ravel()),
        good._replace(preview=good.preview + 1j),
        good._replace(spacing=0.0),
    ]


ANSWERS = st.sampled_from([*NUMBERS, *OTHERS, Decision(0.1, Status.FALLBACK), Decision(0.1, 9)])
# What is just possible, and no road.
EDGES = (
    {"v_x": 100.0, "v_y": 30.0, "yaw_rate": -5.0},
    {"curvature": 1.0, "heading_error": 3.1},
    {"lateral_error": 20.0, "v_x": -100.0},
    {"preview": np.zeros((15, 2), dtype=np.int64)},
)
SIGHTS = st.one_of(st.just(0), st.just(0), st.integers(1, len(bad_observations())))


@settings(max_examples=60)
@given(
    scripts=st.tuples(*[st.lists(ANSWERS, max_size=25)] * 3),
    sights=st.lists(SIGHTS, min_size=25, max_size=25),
    edges=st.lists(st.sampled_from([{}, {}, *EDGES]), min_size=25, max_size=25),
    tells=st.booleans(),
    wander=st.booleans(),
    rate=st.sampled_from([None, 0.5]),
)
def test_whatever_they_return_the_command_is_one(
    scripts: Any, sights: list[int], edges: list[Any], tells: bool, wander: bool, rate: float | None
) -> None:
    three = [Scripted(script=tuple(script), tells=tells) for script in scripts]
    controller = Supervisor(inner=three[0], fallback=three[1], last=three[2], rate=rate)
    observations = scenes(Posed()) if wander else steady(25)
    observations = [o._replace(**edge) for o, edge in zip(observations, edges, strict=True)]
    seen = [
        bad_observations()[k - 1] if k else o for k, o in zip(sights, observations, strict=True)
    ]
    state, last, most = controller.init(CAR, DT), None, STEP if rate is None else rate * DT
    for observation, usable in zip(seen, sights, strict=True):
        decision, state = controller.step(state, observation)
        assert isinstance(decision.steer, float)
        assert -1.0 <= decision.steer <= 1.0
        if last is not None:
            assert abs(decision.steer - last) <= most + 1e-12
        if last is None and usable == 0:
            assert abs(decision.steer - observation.steer) <= most + 1e-12
        last = state.last
        assert last is None or last == decision.steer
        assert decision.driver is Driver.INNER or decision.reason is not Reason.NONE
        assert decision.driver is Driver.INNER or decision.status is Status.FALLBACK


FAULTS = {
    Reason.EXCEPTION: "raise",
    Reason.COMMAND: math.nan,
    Reason.COMMAND_LIMIT: 1.5,
    Reason.UNSOLVED: Decision(GOOD, Status.FALLBACK),
}


@pytest.mark.parametrize("reason", FAULTS)
def test_a_fault_of_the_controller_hands_over_at_once(reason: Reason) -> None:
    inner = Scripted(script=(GOOD, GOOD, FAULTS[reason]))
    got = decisions(supervised(inner), steady(6))
    assert [one.driver for one in got] == [Driver.INNER] * 2 + [Driver.FALLBACK] * 4
    assert {one.reason for one in got[2:]} == {reason}


def test_what_is_wrong_with_an_observation_is_named() -> None:
    expected = [Reason.MISSING] * 2 + [Reason.INPUT_NOT_FINITE] + [Reason.INPUT_RANGE] * 2
    expected += [Reason.INPUT_NOT_FINITE] + [Reason.INPUT_RANGE] * 2 + [Reason.MISSING] * 2
    expected += [Reason.INPUT_RANGE] * 2 + [Reason.MISSING, Reason.INPUT_RANGE]
    for bad, reason in zip(bad_observations(), expected, strict=True):
        got = decisions(supervised(), [steady(1)[0], bad])[-1]
        assert (got.driver, got.reason) == (Driver.INNER, reason)


def test_commands_in_haste_are_limited_and_handed_over_if_they_go_on() -> None:
    inner = Scripted(script=(0.0,) * 3 + (0.8, -0.8) * 10)
    got = decisions(supervised(inner), steady(15))
    assert got[3].status is Status.SATURATED
    assert [one.driver for one in got[:9]] == [Driver.INNER] * 9
    assert (got[9].driver, got[9].reason) == (Driver.FALLBACK, Reason.COMMAND_RATE)
    calm = Scripted(script=(0.0,) * 3 + (0.8,) * 20)  # one step is no haste
    assert set(drivers(supervised(calm), steady(15))) == {Driver.INNER}


def test_one_after_the_other_fails() -> None:
    inner = Scripted(script=(GOOD, "raise") + ("raise",) * 40)
    fallback = Scripted(script=(GOOD,) * 3 + (math.nan,) * 40)
    last = Scripted(script=(GOOD,) * 5 + (2.0,) * 2)
    controller = supervised(inner, fallback=fallback, last=last)
    got = decisions(controller, steady(9))
    names = [one.driver.name for one in got]
    assert names == ["INNER", *["FALLBACK"] * 2, *["LAST"] * 2, *["HOLD"] * 2, *["LAST"] * 2]
    assert [one.reason for one in got[1:7]] == [
        *[Reason.EXCEPTION] * 2,
        *[Reason.COMMAND] * 2,
        *[Reason.COMMAND_LIMIT] * 2,
    ]


@pytest.mark.parametrize("seconds", [0.0, 0.5, 2.0])
def test_it_is_given_back_after_a_time_without_fault(seconds: float) -> None:
    """Counted from the last fault, not from the first."""
    steps = round(seconds / DT)
    inner = Scripted(script=(GOOD, "raise", GOOD, GOOD, "raise"))
    got = drivers(supervised(inner, recover_time=seconds), steady(steps + 10))
    if steps:
        assert got[1 : 5 + steps - 1] == [Driver.FALLBACK] * (steps + 3)
        assert set(got[5 + steps - 1 :]) == {Driver.INNER}
    else:
        assert [k for k, one in enumerate(got) if one is not Driver.INNER] == [1, 4]


@pytest.mark.parametrize(("d", "after"), [(0.5, Driver.INNER), (0.7, Driver.FALLBACK)])
def test_it_is_given_back_within_half_the_corridor(d: float, after: Driver) -> None:
    inner = Scripted(script=(GOOD, "raise"))
    controller = supervised(inner, corridor=1.2, foresight=0.0, recover_time=0.2)
    got = drivers(controller, steady(20, d))
    assert got[:2] == [Driver.INNER, Driver.FALLBACK]
    assert got[-1] is after


def test_a_short_gap_is_bridged_a_long_one_hands_over() -> None:
    good = steady(120)
    short, long, longest = list(good), list(good), list(good)
    short[10:16], long[10:18], longest[10:50] = [None] * 6, [None] * 8, [None] * 40
    got = decisions(supervised(), short)
    assert {one.driver for one in got} == {Driver.INNER}
    assert [k for k, one in enumerate(got) if one.reason is Reason.MISSING] == [*range(10, 16)]
    got = drivers(supervised(recover_time=1.0), long)
    # From 0.3 s on the fallback steers by what would be seen, and for 1 s after the gap.
    assert [k for k, one in enumerate(got) if one is not Driver.INNER] == [*range(16, 18 + 19)]
    got = drivers(supervised(recover_time=1.0), longest)
    assert got[16:40] == [Driver.FALLBACK] * 24
    assert got[40:50] == [Driver.HOLD] * 10  # after 1.5 s nobody
    assert got[50:69] == [Driver.FALLBACK] * 19
    assert set(got[69:]) == {Driver.INNER}


def frozen(observation: Observation, n: int, *, stamped: bool) -> list[Observation]:
    """The same again and again; if ``stamped``, with a time that goes on."""
    step = DT if stamped else 0.0
    return [observation._replace(time=observation.time + k * step) for k in range(n)]


def test_a_frozen_observation_is_found() -> None:
    got = decisions(supervised(), frozen(steady(1)[0], 12, stamped=True))
    assert {(one.driver, one.reason) for one in got[:7]} == {(Driver.INNER, Reason.NONE)}
    assert {(one.driver, one.reason) for one in got[7:]} == {(Driver.FALLBACK, Reason.STALE)}
    again = decisions(supervised(), frozen(steady(1)[0], 12, stamped=False))
    assert {(one.driver, one.reason) for one in again[1:7]} == {(Driver.INNER, Reason.MISSING)}
    assert {(one.driver, one.reason) for one in again[7:]} == {(Driver.FALLBACK, Reason.MISSING)}


def test_who_stands_or_drives_straight_ahead_may_see_the_same() -> None:
    standing = steady(1)[0]._replace(v_x=0.1)
    path = Straight()
    ahead = observe(path, beside(path, 3.0), 3.0)
    for observation in (standing, ahead):
        fresh, stale = (frozen(observation, 12, stamped=s) for s in (True, False))
        assert set(drivers(supervised(), fresh)) == {Driver.INNER}
        assert drivers(supervised(), stale)[-1] is Driver.FALLBACK


def ticking(*seconds: float) -> Callable[[], float]:
    """A clock that goes on by these times with every look at it."""
    now, steps = [0.0], iter(seconds)

    def look() -> float:
        now[0] += next(steps, 0.0)
        return now[0]

    return look


def test_a_late_answer_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    # Two looks for each of three controllers: the inner one is late at its second step.
    monkeypatch.setattr(Supervisor, "clock", staticmethod(ticking(*[0.0] * 7, 0.03)))
    got = decisions(supervised(deadline=0.02), steady(4))
    assert [one.driver for one in got] == [Driver.INNER] + [Driver.FALLBACK] * 3
    assert {one.reason for one in got[1:]} == {Reason.DEADLINE}


def test_without_a_deadline_time_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_clock() -> float:
        raise AssertionError("nobody asks for the time")

    monkeypatch.setattr(Supervisor, "clock", staticmethod(no_clock))
    runs = [drive(Supervisor(), Posed(), duration=3.0) for _ in range(2)]
    assert same(*runs)
    assert runs[0].interventions() == []


def short_drives() -> list[RunConfig]:
    """The first seconds of clean and disturbed drives of the test suite."""
    paths = ("circle_50_left", "lemniscate", "iso_3888_1", "surveyed_3")
    words = ("clean", "delay_100ms", "noise_0.1m", "pose_noise")
    return [
        one.run.model_copy(update={"duration": 2.0, "laps": None})
        for one in suite("standard").scenarios()
        if one.path in paths and one.disturbance in words and one.speed == "constant"
    ]


@pytest.mark.parametrize("name", ["tuned/mpc_delay", "tuned/lqr", "policy"])
def test_a_healthy_controller_drives_as_if_alone(name: str) -> None:
    """To the bit; there are no false alarms."""
    alone = resolve("controller", name)
    guarded = Supervisor(inner=alone)
    for config in short_drives():
        episodes = [run(config.model_copy(update={"controller": c})) for c in (alone, guarded)]
        assert episodes[1].interventions() == []
        assert same(*episodes)


class Dying(Scripted):
    """Drives like its base until it raises, for ever."""

    kind: ClassVar[str] = "dying"
    base: Any = None
    at: float = 3.0

    def init(self, vehicle: Any, dt: float) -> Any:
        return self.base.init(vehicle, dt)

    def step(self, state: Any, observation: Observation) -> Any:
        if observation.time > self.at:
            raise RuntimeError("dead")
        return self.base.step(state, observation)

    def executed(self, state: Any, steer: float) -> Any:
        return self.base.executed(state, steer)


def deadly(side: float = 1.0, **fields: Any) -> Episode:
    inner = Dying(base=resolve("controller", "tuned/mpc_delay"))
    controller = Supervisor(inner=inner, **fields)
    return drive(controller, Posed(side=side), speed=ConstantSpeed(speed=10.0), duration=12.0)


def test_who_dies_in_a_corner_is_replaced_without_a_jump() -> None:
    inner = Dying(base=resolve("controller", "tuned/mpc_delay"))
    with pytest.raises(RunError, match="dead"):
        drive(inner, Posed(), speed=ConstantSpeed(speed=10.0), duration=12.0)
    episode = deadly()
    assert episode.completed
    assert [one.reason for one in episode.interventions()] == ["exception"]
    assert abs(episode["lateral_error"]).max() < 0.5
    changes, row = abs(np.diff(episode["steer_command"])), 61
    assert episode["driver"][row - 1 : row + 1].tolist() == [0.0, 1.0]
    before = changes[row - 11 : row - 1].max()
    jump = deadly(blend_time=0.0)["steer_command"][row] - episode["steer_command"][row - 1]
    assert changes[row - 1] <= before + abs(jump) * DT / 0.5 + 1e-12
    assert changes[row - 1 : row + 10].max() < 0.02


def test_a_mirrored_intervention_is_mirrored() -> None:
    left, right = deadly(), deadly(-1.0)
    assert left["steer_command"] == pytest.approx(-right["steer_command"], abs=1e-8)
    assert np.array_equal(left["driver"], right["driver"])


def test_who_leaves_the_corridor_is_caught() -> None:
    weak = {"kind": "pid", "gains": {"k_p": 0.01, "k_i": 0.0, "k_d": 0.0}}
    speed = ConstantSpeed(speed=7.0)
    alone = drive(resolve("controller", weak), Posed(), speed=speed)
    episode = drive(Supervisor(inner=weak), Posed(), speed=speed)
    assert alone.end == "off_track"
    assert episode.completed
    assert {one.reason for one in episode.interventions()} == {"corridor"}


def test_oscillation_is_found() -> None:
    wild = {"kind": "pid", "gains": {"k_p": 0.4, "k_i": 0.0, "k_d": 0.0}}
    controller = Supervisor(inner=wild, corridor=1.45, foresight=0.0)
    speed = ConstantSpeed(speed=10.0)
    car = CarlaModel3V1()  # slower to answer
    episode = drive(controller, Circle(), speed=speed, vehicle=car, duration=10.0)
    assert "oscillation" in {one.reason for one in episode.interventions()}


@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=60))
def test_swings_are_the_same_mirrored(values: list[float]) -> None:
    one, other = still(6), still(6)
    for value in values:
        one, other = (s.after(sign * value, 3.0, DT) for s, sign in ((one, 1), (other, -1)))
        assert one.ages == other.ages


@pytest.mark.parametrize(("size", "turns"), [(1.4, 0), (1.6, 6)])
def test_swings_of_a_sine(size: float, turns: int) -> None:
    """One a second has two turns a second, but not if it turns back by less than the gap."""
    swings = still(12)
    for k in range(200):
        swings = swings.after(size * math.sin(2.0 * math.pi * k * DT), 3.0, DT)
    assert sum(age < 3.0 for age in swings.ages) == turns


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_would_be_seen_is_what_is_seen(side: float) -> None:
    """Half a second of a drive through corners, reckoned from its first moment."""
    path, sensor, rng = Posed(side=side), WaypointSensor(), np.random.default_rng(0)
    plant, controller = SimulatorConfig().make(CAR), resolve("controller", "tuned/mpc_delay")
    car = plant.reset(Pose(0.0, 0.1 * side, 0.0), 10.0, 0.0)
    state, seen, motion = controller.init(CAR, DT), None, None
    for k in range(70):
        o = sensor.observe(None, car, track(car, path, 0.5 * k), path, rng)
        if k == 60:
            seen = o
        if seen is not None and motion is not None:
            would = reckoned(seen, motion, o.time)
            assert would is not None
            assert would[:3] == pytest.approx(o[:3], abs=5e-3)
            assert would[4:8] == pytest.approx(o[4:8], abs=0.02)
            assert would.preview == pytest.approx(o.preview, abs=0.2)
        decision, state = controller.step(state, o)
        if seen is not None:
            motion = moved_on(CAR, seen, motion, decision.steer, DT)
        car = plant.step(Command(decision.steer, 0.4, 0.0))
    assert seen is not None
    assert motion is not None
    far = motion.copy()
    far[kernel.WAY] = 28.1
    assert reckoned(seen, far, 0.0) is None


@pytest.mark.parametrize("error", [0.0, 0.1])
def test_errors_of_waypoints_are_smoothed_as_far_as_there_are_any(error: float) -> None:
    path, rng = Posed(), np.random.default_rng(1)
    car = beside(path, 30.0)
    place, exact = track(car, path, 30.0), observe(path, car, 30.0)
    seen = WaypointSensor(error_range=error).observe(None, car, place, path, rng)
    if error:
        rough, smooth = (np.diff(p - exact.preview, 2, axis=0) for p in (seen.preview, quiet(seen)))
        assert np.square(smooth).mean() < 0.05 * np.square(rough).mean()
        assert abs(quiet(seen) - exact.preview).max() < error
    else:
        assert quiet(seen) == pytest.approx(exact.preview, abs=2e-3)


def test_nobody_steers_along_the_road_or_straight() -> None:
    path = Posed()
    into = observe(path, beside(path, 30.0), 30.0)
    assert held(CAR, into, 0.1, DT) > 0.1
    assert held(CAR, None, 0.1, DT) == pytest.approx(0.1 - STRAIGHTEN * DT)
    assert held(CAR, None, -0.01, DT) == 0.0


def test_the_inner_controller_cannot_spoil_what_others_see() -> None:
    class Spoiling(Scripted):
        kind: ClassVar[str] = "spoiling"

        def step(self, state: Any, observation: Observation) -> Any:
            observation.preview[:] = math.nan
            return super().step(state, observation)

    observation = steady(1)[0]
    kept = observation.preview.copy()
    decisions(supervised(Spoiling()), [observation])
    assert np.array_equal(observation.preview, kept)


def test_what_does_not_fit_is_told_at_once() -> None:
    few = observe(Circle(), beside(Circle(), 1.0), 1.0)._replace(spacing=3.0)
    controller = Supervisor(inner="policy")
    with pytest.raises(ConfigError, match=r"set sensor\.count"):
        controller.step(controller.init(CAR, DT), few)


def test_a_checkpoint_keeps_its_state() -> None:
    """In the middle of an intervention, when numbers have lost their names."""
    inner = Dying(base=resolve("controller", "pid"), at=0.3)
    controller = Supervisor(inner=inner, recover_time=0.2)
    observations: list[Any] = [*scenes(Posed())[:10], None, None, *scenes(Posed())[12:]]
    for k in range(len(observations)):
        state = fresh = controller.init(CAR, DT)
        for observation in observations[:k]:
            _, state = controller.step(state, observation)
        file = io.BytesIO()
        write({"state": changed(state, fresh)}, file)
        again, rest = rebuilt(read(file)["state"], fresh), observations[k:]
        assert answers(controller, rest, again) == answers(controller, rest, state)


def test_nested_controllers_are_given_by_name_with_gains() -> None:
    words = ["controller=supervisor", "controller.inner=tuned/lqr", "controller.inner.r=3"]
    found = build(RunConfig, override({}, words)).controller
    assert isinstance(found, Supervisor)
    tuned = resolve("controller", "tuned/lqr")
    assert isinstance(tuned, ControllerComponent)
    assert found.inner == tuned.model_copy(update={"r": 3.0})
    with pytest.raises(ConfigError, match="did you mean 'lqr'"):
        build(RunConfig, override({}, ["controller=supervisor", "controller.last=lqrr"]))
