"""What holds for every registered controller. A new one is found here with no further edit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from steersman.config import build, components, dump, resolve
from steersman.controllers.base import ControllerComponent
from steersman.learning.config import TrainConfig
from steersman.paths.basic import Circle
from steersman.plants.simulator import SimulatorConfig
from steersman.sensing import WaypointSensor
from steersman.types import Observation, Status

from .loops import CAR, DT, Posed, answers, beside, drive, observe, random_policy, same, scenes

# Further settings of kinds whose defaults leave code aside.
VARIANTS: dict[str, dict[str, Any]] = {
    "mpc-limits": {"kind": "mpc", "rate_limit": True, "corridor": 0.2, "scheduled": True},
    "mpc_delay-given": {"kind": "mpc_delay", "delay": 0.12},
    "mpc_delay-plain": {"kind": "mpc_delay", "disturbance_time": None, "filter_road": False},
    "mpc_pid-limits": {"kind": "mpc_pid", "rate_limit": True, "corridor": 0.2},
    "mpc_pid-scheduled": {"kind": "mpc_pid", "scheduled": True},
    "mpc_pid-wrong": {"kind": "mpc_pid", "model_error": {"mass": 1.3, "c_r": 0.8}},
    "policy-residual": {"kind": "policy"},
    "pid-feedforward": {"kind": "pid", "feedforward": True, "k_heading": 0.3},
    "pure_pursuit-centre": {"kind": "pure_pursuit", "track": "centre_of_mass"},
    "stanley-centre": {"kind": "stanley", "track": "centre_of_mass", "steer_damping": 0.2},
}
ALL = {**{kind: {"kind": kind} for kind in components("controller")}, **VARIANTS}
PROBLEMS: dict[str, dict[str, Any]] = {
    "policy": {},
    "policy-residual": {"action": "residual", "base": "mpc_delay", "authority": 0.3},
}


@pytest.fixture(scope="session")
def policies(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Files of policies by the names of controllers.

    Their networks are odd, which is a matter of training, not of the code; what is around them has
    to treat left and right alike.
    """
    return {
        name: str(
            random_policy(
                tmp_path_factory.mktemp(name),
                build(TrainConfig, {"problem": fields}),
                odd=True,
            )
        )
        for name, fields in PROBLEMS.items()
    }


def make(name: str, policies: Mapping[str, str]) -> ControllerComponent:
    fields = dict(ALL[name])
    if name in policies:
        fields["file"] = policies[name]
    controller = resolve("controller", fields)
    assert isinstance(controller, ControllerComponent)
    return controller


@pytest.fixture(params=ALL)
def controller(request: pytest.FixtureRequest, policies: dict[str, str]) -> ControllerComponent:
    """Each controller in turn."""
    return make(request.param, policies)


def tolerance(controller: ControllerComponent, single: float = 1e-6) -> float:
    """Of a comparison; a policy's network has single precision."""
    return single if controller.kind == "policy" else 1e-9


def steering(controller: ControllerComponent, observations: list[Observation]) -> list[float]:
    return [decision.steer for decision in answers(controller, observations)]


def test_load_undoes_dump(controller: ControllerComponent) -> None:
    again = resolve("controller", dump(controller))
    assert again == controller
    assert isinstance(again, ControllerComponent)
    observations = scenes(Posed())
    assert answers(again, observations) == answers(controller, observations)


def test_mirrored_observation_gives_negated_steering(controller: ControllerComponent) -> None:
    left = steering(controller, scenes(Posed()))
    right = steering(controller, scenes(Posed(side=-1.0), side=-1.0))
    assert left == pytest.approx([-u for u in right], abs=tolerance(controller))
    assert max(map(abs, left)) > 1e-3


def test_mirrored_circle_gives_mirrored_run(controller: ControllerComponent) -> None:
    left = drive(controller, Circle(direction="left"), duration=4.0)
    right = drive(controller, Circle(direction="right"), duration=4.0)
    assert left.end == right.end
    close = tolerance(controller, 1e-5)
    for name in ("lateral_error", "heading_error", "steer_command", "yaw_rate"):
        assert left[name] == pytest.approx(-right[name], abs=close), name


MOVED = Posed(x=-350.0, y=120.0, psi=2.4)


def test_steering_knows_no_place_and_direction(controller: ControllerComponent) -> None:
    here, there = steering(controller, scenes(Posed())), steering(controller, scenes(MOVED))
    assert here == pytest.approx(there, abs=tolerance(controller))


def test_observations_know_no_place_and_direction() -> None:
    for a, b in zip(scenes(Posed()), scenes(MOVED), strict=True):
        assert a[:8] == pytest.approx(b[:8], abs=1e-10)
        assert a.preview == pytest.approx(b.preview, abs=1e-10)


def test_closed_loop_knows_no_place_and_direction(controller: ControllerComponent) -> None:
    here, there = (drive(controller, path, duration=6.0) for path in (Posed(), MOVED))
    assert here.end == there.end
    close = tolerance(controller, 1e-5)
    for name in ("s", "lateral_error", "heading_error", "course_error", "steer_command", "v_x"):
        assert here[name] == pytest.approx(there[name], abs=close), name


def plain() -> Observation:
    path = Posed()
    return observe(path, beside(path, 30.0, d=0.1, heading=0.02, steer=0.25), 30.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", [*Observation._fields[:8], "preview"])
def test_input_that_is_not_finite_is_a_marked_fallback(
    controller: ControllerComponent, field: str, value: float
) -> None:
    good = plain()
    if field == "preview":
        points = good.preview.copy()
        points[7, 1] = value
        bad = good._replace(preview=points)
    else:
        bad = good._replace(**{field: value})
    state = controller.init(CAR, DT)
    decision, after = controller.step(state, bad)
    assert decision.status is Status.FALLBACK
    assert decision.steer == (0.0 if field == "steer" else 0.25)
    # The next good observation is answered as if nothing had been.
    assert controller.step(after, good)[0] == controller.step(controller.init(CAR, DT), good)[0]


@pytest.mark.parametrize("size", [1e-300, 1e3, 1e9, 1e100, 1e300])
def test_any_finite_input_gives_a_command(controller: ControllerComponent, size: float) -> None:
    good, points = plain(), plain().preview
    extremes = [good._replace(**{f: s * size}) for f in Observation._fields[1:8] for s in (1, -1)]
    extremes += [good._replace(preview=s * size * points) for s in (1.0, -1.0)]
    extremes += [good._replace(v_x=v, v_y=0.0) for v in (0.0, -5.0, 200.0)]
    for decision in answers(controller, extremes):
        assert -1.0 <= decision.steer <= 1.0
        assert decision.status in set(Status)


@pytest.mark.parametrize("size", [1e3, 1e100, 1e300])
def test_extreme_input_leaves_nothing_behind(controller: ControllerComponent, size: float) -> None:
    """A glitch may be answered by anything within the limits, but not the minute after it."""
    good = plain()
    for field in Observation._fields[1:8]:
        state = controller.init(CAR, DT)
        for observation in (good, good._replace(**{field: size}), *[good] * 5):
            decision, state = controller.step(state, observation)
        assert decision.status in {Status.SOLVED, Status.SATURATED}, field


def test_a_standing_car_gets_an_ordinary_answer(controller: ControllerComponent) -> None:
    path = Posed()
    cars = [beside(path, 30.0, d=d, heading=0.05, velocity=(0.0, 0.0)) for d in (0.0, 0.3, -0.3)]
    for decision in answers(controller, [observe(path, car, 30.0) for car in cars]):
        assert decision.status in {Status.SOLVED, Status.SATURATED}


def test_limits_are_kept(controller: ControllerComponent) -> None:
    rng = np.random.default_rng(1)
    path = Posed()
    observations = [
        observe(path, beside(path, 30.0, d=d, heading=h, velocity=(v, 0.0)), 30.0)
        for d, h, v in rng.uniform((-20.0, -3.0, 0.0), (20.0, 3.0, 60.0), (60, 3)).tolist()
    ]
    assert all(-1.0 <= u <= 1.0 for u in steering(controller, observations))


def test_same_seed_same_episode(controller: ControllerComponent) -> None:
    noisy = WaypointSensor(error_range=0.1)
    runs = [drive(controller, Posed(), sensor=noisy, seed=seed, duration=4.0) for seed in (5, 5, 6)]
    assert same(runs[0], runs[1])
    assert not same(runs[0], runs[2])


def test_one_object_drives_two_cars_in_turn(controller: ControllerComponent) -> None:
    observations = scenes(Posed()), scenes(Posed(side=-1.0), side=0.5)
    alone = [answers(controller, row) for row in observations]
    states = [controller.init(CAR, DT) for _ in observations]
    together: list[list[Any]] = [[], []]
    for pair in zip(*observations, strict=True):
        for i, observation in enumerate(pair):
            decision, states[i] = controller.step(states[i], observation)
            together[i].append(decision)
    assert together == alone


def test_one_first_state_serves_many_cars(controller: ControllerComponent) -> None:
    """The demonstrator starts every episode of every vehicle from one state."""
    fresh, observations = controller.init(CAR, DT), scenes(Posed())
    first = answers(controller, observations, fresh)
    answers(controller, scenes(Posed(side=-1.0), side=-1.0), fresh)
    assert answers(controller, observations, fresh) == first


def test_asking_twice_gives_the_same_answer(controller: ControllerComponent) -> None:
    state = controller.init(CAR, DT)
    for observation in scenes(Posed()):
        once, after = controller.step(state, observation)
        again, _ = controller.step(state, observation)
        assert once == again
        state = after


def commands(seed: int = 0) -> list[float]:
    """Somebody else's commands."""
    return np.random.default_rng(seed).uniform(-0.3, 0.3, 25).tolist()


def told(
    controller: ControllerComponent, observations: list[Observation], *others: list[float]
) -> list[float]:
    """Steering after ``others`` were told, one after the other, of each step."""
    state, out = controller.init(CAR, DT), []
    for observation, *steers in zip(observations, *others, strict=True):
        decision, state = controller.step(state, observation)
        for steer in steers:
            state = controller.executed(state, steer)
        out.append(decision.steer)
    return out


def test_its_own_command_is_no_news(controller: ControllerComponent) -> None:
    observations = scenes(Posed())
    alone = steering(controller, observations)
    assert told(controller, observations, alone) == alone


def test_the_last_that_is_told_counts(controller: ControllerComponent) -> None:
    observations = scenes(Posed())
    once = told(controller, observations, commands())
    twice = told(controller, observations, commands(1), commands())
    assert twice == pytest.approx(once, abs=tolerance(controller))


def test_mirrored_news_gives_negated_steering(controller: ControllerComponent) -> None:
    left = told(controller, scenes(Posed()), commands())
    mirrored = scenes(Posed(side=-1.0), side=-1.0), [-u for u in commands()]
    right = told(controller, *mirrored)
    assert left == pytest.approx([-u for u in right], abs=tolerance(controller))


def test_telling_leaves_the_state_alone(controller: ControllerComponent) -> None:
    observations = scenes(Posed())
    alone, state = steering(controller, observations), controller.init(CAR, DT)
    for observation, steer, expected in zip(observations, commands(), alone, strict=True):
        decision, state = controller.step(state, observation)
        other, _ = controller.step(controller.executed(state, steer), observation)
        assert decision.steer == expected
        assert -1.0 <= other.steer <= 1.0


def test_before_the_first_step_there_is_nothing_to_tell(controller: ControllerComponent) -> None:
    fresh, first = controller.init(CAR, DT), plain()
    assert (
        controller.step(controller.executed(fresh, 0.0), first)[0]
        == (controller.step(fresh, first)[0])
    )


def test_observation_is_left_alone(controller: ControllerComponent) -> None:
    observation = plain()
    kept = observation.preview.copy()
    controller.step(controller.init(CAR, DT), observation)
    assert np.array_equal(observation.preview, kept)


@pytest.mark.parametrize("kind", components("controller"))
def test_what_tuning_may_change_holds_the_defaults(kind: str) -> None:
    for name, (low, high, log) in components("controller")[kind].search.items():
        value: Any = make(kind, {})
        for part in name.split("."):
            value = getattr(value, part)
        assert low <= value <= high, name
        assert low < high, name
        assert low > 0.0 or not log, name


@pytest.mark.parametrize("name", [name for name in ALL if name not in PROBLEMS])
@pytest.mark.parametrize("dt", [0.01, 0.1])
def test_other_control_periods(name: str, dt: float) -> None:
    """A policy belongs to the period it was trained with, and says so (test_policy_file)."""
    controller = make(name, {})
    episode = drive(controller, Posed(), plant=SimulatorConfig(dt=dt), duration=2.0)
    assert episode.dt == dt
    assert len(episode) == round(2.0 / dt)
