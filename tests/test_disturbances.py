"""Sensors that err as real ones do: biases, drift, latency, drop-outs; starts; stop and go."""

from __future__ import annotations

import copy
from typing import Any, ClassVar

import numpy as np
import pytest

from steersman.config import build, override
from steersman.contracts import disturbance as contract
from steersman.controllers.base import ControllerComponent
from steersman.disturbances import (
    DisturbanceComponent,
    Dropouts,
    FrictionPatch,
    PositionDrift,
    SensorBias,
)
from steersman.errors import ConfigError
from steersman.learning.problem import Problem
from steersman.learning.vec_env import PathFollowingVecEnv
from steersman.paths.analytic import Circle
from steersman.paths.base import Start
from steersman.plants.simulator import SimulatorConfig
from steersman.report.marks import marks
from steersman.report.seen import path_of, waypoints
from steersman.rollout import RunConfig, attempt, run
from steersman.sensing import WaypointSensor
from steersman.speed import ConstantSpeed, SpeedTracking, StopAndGo
from steersman.types import Observation, Status
from steersman.vehicles import CarlaModel3

SEEN: list[Observation] = []


class Recording(ControllerComponent):
    """Holds its steering and keeps what it saw in the module."""

    def init(self, vehicle: Any, dt: float) -> None:
        """Nothing to keep."""

    def decide(self, state: Any, observation: Observation) -> Any:
        """About what the circle needs."""
        SEEN.append(observation)
        return 0.12, Status.SOLVED, None


def seen(**changes: Any) -> tuple[Any, list[Observation]]:
    """A drive of 3 s with open-loop steering, and its observations without the warming up."""
    config = RunConfig(
        controller=Recording(), path=Circle(), speed=ConstantSpeed(speed=9.0), duration=3.0
    )
    SEEN.clear()
    episode = run(config.model_copy(update=changes))
    return episode, SEEN[-len(episode) :]


def bias(**values: Any) -> SensorBias:
    return SensorBias(**values)


@pytest.mark.parametrize("periods", [1, 2, 5])
def test_a_late_observation_is_that_of_some_steps_ago(periods: int) -> None:
    exact, on_time = seen()
    episode, late = seen(sensor=WaypointSensor(latency=0.05 * periods))
    assert np.array_equal(episode["x"], exact["x"])
    for k in range(len(late)):
        then = on_time[max(k - periods, 0)]
        arrays: Any = {"preview": None, "wished": None}
        assert late[k].time == pytest.approx((k - periods) * 0.05)
        assert late[k]._replace(time=then.time, **arrays) == then._replace(**arrays)
        assert np.array_equal(late[k].preview, then.preview)


def test_latency_is_whole_control_periods() -> None:
    with pytest.raises(ConfigError, match=r"^sensor\.latency: 0\.07 is not allowed; give"):
        seen(sensor=WaypointSensor(latency=0.07))


def test_a_scale_of_v_x_is_in_proportion_to_it() -> None:
    episode, shown = seen(disturbances=(SensorBias(v_x_scale=0.05, v_x=0.1),))
    measured = np.array([one.v_x for one in shown])
    assert measured == pytest.approx(1.05 * episode["v_x"] + 0.1, rel=1e-12)


def test_drawn_biases_stay_for_a_drive_and_differ_between_drives() -> None:
    offsets = []
    for seed in range(40):
        episode, shown = seen(
            disturbances=(SensorBias(v_y=0.1, drawn=True),), seed=seed, duration=0.5
        )
        offset = np.array([one.v_y for one in shown]) - episode["v_y"]
        assert np.ptp(offset) < 1e-12
        offsets.append(offset[0])
    assert np.abs(offsets).max() <= 0.1
    assert min(offsets) < -0.05 < 0.05 < max(offsets)


def test_drift_has_its_deviation_and_its_correlation_time() -> None:
    """Over vehicles: N(0, deviation) at every time, correlated by exp(-t / time)."""
    drift = PositionDrift(deviation=0.2, time=1.0)
    n = 400
    task = Problem(
        roads=(Circle(radius=5000.0),),
        speeds=(ConstantSpeed(speed=5.0),),
        disturbances=(drift,),
        action="direct",
        demonstration={"enabled": False},
    )
    env = PathFollowingVecEnv(task, n)
    env.seed(3)
    env.reset()
    fleet = env.driver.fleet
    first = fleet.errors[:, :2].copy()
    for _ in range(20):
        env.step(np.zeros((n, 1)))
    last = fleet.errors[:, :2]
    assert first.std() == pytest.approx(0.2, rel=0.1)
    assert last.std() == pytest.approx(0.2, rel=0.1)
    correlation = float(np.mean(first * last)) / 0.2**2
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.12)


def test_what_drops_out_is_replaced_by_the_last_one_with_its_time() -> None:
    episode, shown = seen(disturbances=(Dropouts(share=0.3),), duration=20.0)
    times = np.array([one.time for one in shown])
    lost = times != episode["time"]
    assert 0.2 < lost.mean() < 0.4
    assert not lost[0]
    for k in np.flatnonzero(lost):
        assert shown[k].time == shown[k - 1].time
        assert np.array_equal(shown[k].preview, shown[k - 1].preview)


ALL: dict[str, dict[str, Any]] = {
    "biases": {"disturbances": (SensorBias(v_y=0.1, yaw_rate=0.01, v_x_scale=0.05, drawn=True),)},
    "drift": {"disturbances": (PositionDrift(),)},
    "dropouts": {"disturbances": (Dropouts(share=0.2),)},
    "latency": {"sensor": WaypointSensor(latency=0.1, error_range=0.1, position_noise=0.02)},
    "everything": {
        "disturbances": (SensorBias(v_y=0.1), PositionDrift(), Dropouts(share=0.2)),
        "sensor": WaypointSensor(latency=0.1, error_range=0.1, redraw=False, heading_noise=0.01),
    },
}


@pytest.mark.parametrize("name", ALL)
def test_a_report_shows_the_waypoints_that_arrived(name: str) -> None:
    episode, shown = seen(**ALL[name])
    found = waypoints(episode, path_of(episode))
    assert found is not None
    assert np.array_equal(found, np.array([one.preview for one in shown]))


@pytest.mark.parametrize("name", ALL)
def test_a_learner_meets_them_and_goes_on_from_a_snapshot(name: str) -> None:
    off = {"enabled": False}
    task = Problem(speeds=(StopAndGo(),), action="direct", demonstration=off, **ALL[name])

    def made() -> PathFollowingVecEnv:
        env = PathFollowingVecEnv(task, 2)
        env.seed(1)
        env.reset()
        return env

    def played(env: PathFollowingVecEnv, steps: int) -> Any:
        return np.array([env.step(np.full((2, 1), 0.02))[0] for _ in range(steps)])

    env = made()
    played(env, 30)
    saved = copy.deepcopy(env.snapshot())
    rest = played(env, 60)
    other = made()
    other.restore(saved)
    assert np.array_equal(played(other, 60), rest)


class FullBraking(SpeedTracking):
    """From 15 m/s to a stop at once."""

    family: ClassVar[str] = "speed"

    def breakpoints(self) -> Any:
        """A step down."""
        return np.array([0.0, 0.01]), np.array([15.0, 0.0])


class Straight(ControllerComponent):
    """Steers straight on."""

    def init(self, vehicle: Any, dt: float) -> None:
        """Nothing to keep."""

    def decide(self, state: Any, observation: Observation) -> Any:
        """Zero."""
        return 0.0, Status.SOLVED, None


def braked(**patch: float) -> Any:
    """Full braking on a straight road over a patch of other friction."""
    config = RunConfig(
        controller=Straight(),
        path="straight",
        speed=FullBraking(),
        vehicle=CarlaModel3(friction=0.4),
        disturbances=(FrictionPatch(begin=0.0, length=200.0, **patch),) if patch else (),
        duration=1.0,
    )
    return run(config)


def test_friction_under_the_wheels_limits_what_they_carry() -> None:
    least = braked()["a_x"][-1]
    half = braked(left=0.5, right=0.5)["a_x"][-1]
    assert half == pytest.approx(0.5 * least, rel=0.05)


def test_a_split_road_turns_the_car_to_the_side_that_grips() -> None:
    left, right = braked(left=0.3, right=1.0), braked(left=1.0, right=0.3)
    assert left["yaw_rate"][-1] < -0.01
    assert right["yaw_rate"][-1] == pytest.approx(-left["yaw_rate"][-1], rel=1e-9)


@pytest.mark.parametrize(
    ("every", "covered"),
    [(None, [50.0, 69.9]), (100.0, [50.0, 69.9, 150.0, 1069.9])],
)
def test_a_patch_covers_its_length(every: float | None, covered: list[float]) -> None:
    patch = FrictionPatch(begin=50.0, length=20.0, every=every)
    assert all(patch.covers(s) for s in covered)
    assert not any(patch.covers(s) for s in (0.0, 49.9, 70.0, 130.0))


def test_the_report_marks_other_friction() -> None:
    patch = FrictionPatch(begin=3.0, length=4.0, left=0.5, right=0.8)
    episode, _ = seen(disturbances=(patch,))
    (mark,) = [m for m in marks(episode) if m["kind"] == "friction"]
    assert mark["text"] == "other friction: x 0.5 left, x 0.8 right"
    assert episode["s"][mark["row"]] >= 3.0 > episode["s"][mark["row"] - 1]
    assert episode["s"][mark["until"]] < 7.0 <= episode["s"][mark["until"] + 1]


@pytest.mark.parametrize(
    "disturbance",
    [
        bias(v_y=0.1),
        PositionDrift(),
        Dropouts(share=0.3),
        FrictionPatch(begin=0.0, left=0.1, right=0.1),
    ],
)
def test_disturbances_keep_their_contract(disturbance: DisturbanceComponent) -> None:
    assert contract.check(disturbance) == []


@pytest.mark.parametrize(("offset", "heading"), [(1.0, 0.3), (-0.5, 0.0), (0.0, -0.2)])
def test_a_drive_starts_beside_the_path_and_turned(offset: float, heading: float) -> None:
    start = Start(s=20.0, offset=offset, heading=heading)
    episode, _ = seen(start=start, duration=0.2)
    assert episode["s"][0] == pytest.approx(20.0, abs=1e-6)
    assert episode["lateral_error"][0] == pytest.approx(offset, abs=1e-6)
    assert episode["course_error"][0] == pytest.approx(heading, abs=1e-6)


def test_a_number_is_the_arc_length_of_the_start() -> None:
    assert build(RunConfig, override({}, ["start=20"])).start == Start(s=20.0)
    with pytest.raises(ConfigError, match=r"^start: given as 20, and offset of it too"):
        override({}, ["start=20", "start.offset=1"])
    with pytest.raises(ConfigError, match=r"^start\.offset: 1\.5 is not allowed; the corridor"):
        build(RunConfig, {"start": {"offset": 1.5}})


def test_the_car_stops_and_drives_on() -> None:
    config = RunConfig(controller="lqr", path=Circle(), speed=StopAndGo(speed=6.0, hold=4.0),
                       duration=30.0)  # fmt: skip
    tried = attempt(config)
    speed = tried.episode["v_x"]
    assert tried.outcome == "finished"
    assert speed.max() == pytest.approx(6.0, abs=0.3)
    stands = speed < 0.05
    assert np.count_nonzero(np.diff(stands.astype(int)) == -1) >= 2


def test_a_road_that_a_plant_cannot_have_is_refused() -> None:
    world = RunConfig(disturbances=(FrictionPatch(),)).model_copy(update={"plant": Elsewhere()})
    with pytest.raises(ConfigError, match=r"^disturbances: one of them alters the road"):
        attempt(world)


class Elsewhere(SimulatorConfig):
    """A plant outside the package."""

    embedded: ClassVar[bool] = False
    computed: ClassVar[bool] = False
