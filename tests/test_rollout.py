"""The closed loop: how it starts and ends, what it records, what it does with bad controllers."""

from __future__ import annotations

import itertools
import math
import re
import time
from typing import Any, ClassVar

import numpy as np
import pytest
from pydantic import Field

from steersman import episode as ending
from steersman import rollout
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_pid import MpcPid
from steersman.controllers.pid import Pid, PidGains
from steersman.episode import COLUMNS
from steersman.errors import ConfigError, PlantError
from steersman.kernels.observe import wrap_angle
from steersman.outcome import Interrupted, PlantFailure, RunError
from steersman.paths.analytic import Circle, Straight
from steersman.paths.base import PathComponent, Start
from steersman.plants.simulator import Simulator, SimulatorConfig
from steersman.rollout import RunConfig, attempt, run
from steersman.sensing import WaypointSensor
from steersman.speed import ConstantSpeed, ConstantThrottle
from steersman.types import Command, Decision, Observation, Pose, Status, VehicleState
from steersman.vehicles import Vehicle

from .loops import CAR, DT, Posed, drive, same

GOOD = Pid(feedforward=True, gains=PidGains(k_p=0.1, k_i=0.05, k_d=0.05))


class Scripted(ControllerComponent):
    """Does as told at a step: returns a number, or raises."""

    at: int = 10
    answer: Any = Field(None, exclude=True)

    def init(self, vehicle: Vehicle, dt: float) -> int:
        return 0

    def decide(self, state: int, observation: Observation) -> tuple[float, Status, int]:
        if state == self.at and isinstance(self.answer, BaseException):
            raise self.answer
        return 0.0, Status.SOLVED, state + 1


class Unguarded(Scripted):
    """One that is no ControllerComponent by its behaviour: nobody checks what it returns."""

    def step(self, state: int, observation: Observation) -> tuple[Decision, int]:  # type: ignore[misc]
        return Decision(self.answer if state == self.at else 0.0), state + 1


@pytest.mark.parametrize("speed", [5.0, 9.9, 18.7, 22.2])
@pytest.mark.parametrize("direction", ["left", "right"])
def test_starts_in_the_steady_turn(speed: float, direction: str) -> None:
    path = Circle(direction=direction)
    plant = SimulatorConfig().make(CAR)
    first = plant.reset(Pose(0.0, 0.0, 0.0), speed, path.at(0.0).curvature)
    assert math.hypot(first.v_x, first.v_y) == pytest.approx(speed)
    assert first.yaw_rate == pytest.approx(speed * path.at(0.0).curvature)
    episode = drive(GOOD, path, speed=ConstantSpeed(speed=speed), duration=0.5)
    assert episode["course_error"][0] == pytest.approx(0.0, abs=1e-12)
    assert episode["lateral_error"][0] == pytest.approx(0.0, abs=1e-12)
    # Holding that steering and those pedals keeps the car on the circle.
    state = first
    for _ in range(20):
        state = plant.step(Command(first.steer, first.throttle, first.brake))
    assert path.project(state.x, state.y)[1] == pytest.approx(0.0, abs=1e-3)


def test_starts_where_told() -> None:
    episode = drive(GOOD, Posed(), start=Start(s=30.0), duration=0.2)
    assert episode["s"][0] == pytest.approx(30.0)
    assert episode["x"][0] == pytest.approx(Posed().at(30.0).x)


def test_duration_ends_a_run() -> None:
    episode = drive(GOOD, Circle(), duration=3.0)
    assert episode.end == ending.DURATION
    assert episode.completed
    assert episode["time"] == pytest.approx(DT * np.arange(60))


def test_laps_end_a_run() -> None:
    path = Circle(radius=20.0)
    episode = drive(GOOD, path, laps=2.0)
    assert episode.end == ending.LAPS
    assert episode.distance == pytest.approx(2.0 * path.length, abs=8.0 * DT)
    assert episode.distance >= 2.0 * path.length - 1e-6


def test_distance_is_that_along_the_path() -> None:
    path = Circle(radius=20.0)
    episode = drive(GOOD, path, duration=60.0)
    assert episode.distance == pytest.approx(8.0 * 60.0, rel=5e-3)
    assert episode.distance > 3.0 * path.length


def test_end_of_an_open_path_ends_a_run() -> None:
    episode = drive(GOOD, Posed())
    assert episode.end == ending.END_OF_PATH
    assert episode.distance == pytest.approx(Posed().length, abs=8.0 * DT)


def test_leaving_the_corridor_ends_a_run() -> None:
    episode = drive(Scripted(), Circle(), corridor=0.8)
    assert episode.end == ending.OFF_TRACK
    assert not episode.completed
    # Each row is what the controller saw: all of them inside.
    assert 0.6 < abs(episode["lateral_error"]).max() <= 0.8


def test_full_throttle_on_the_circle_does_not_roll_over() -> None:
    run = RunConfig(
        controller="tuned/lqr",
        path={"kind": "circle", "radius": 50.0},
        speed={"kind": "constant_throttle", "throttle": 1.0},
        duration=60.0,
    )
    episode = attempt(run).of_controller()
    assert episode.end == ending.DURATION
    # A PhysX car with CARLA's figures: 35.7 m/s.
    assert float(episode["v_x"][-1]) == pytest.approx(35.0, abs=1.0)


def test_rolling_over_ends_a_run() -> None:
    tall = CAR.replace(roll_arm=1.5)
    episode = drive(GOOD, Circle(), vehicle=tall, speed=ConstantSpeed(speed=18.0), duration=5.0)
    assert episode.end == ending.ROLL_OVER
    assert not episode.completed


def test_columns_fit_together() -> None:
    path = Circle()
    episode = drive(MpcPid(), path, speed=ConstantThrottle(throttle=0.4), duration=10.0)
    assert set(episode.columns) == set(COLUMNS)
    assert {len(column) for column in episode.columns.values()} == {len(episode)}
    assert all(np.isfinite(column).all() for column in episode.columns.values())
    for k in range(0, len(episode), 20):
        row = {name: float(episode[name][k]) for name in COLUMNS}
        s, d = path.project(row["x"], row["y"])
        at = path.at(s)
        assert row["s"] == pytest.approx(s, abs=1e-9)
        assert row["lateral_error"] == pytest.approx(d, abs=1e-9)
        assert row["heading_error"] == pytest.approx(wrap_angle(row["psi"] - at.psi), abs=1e-9)
        slip = math.atan2(row["v_y"], row["v_x"])
        assert row["course_error"] == pytest.approx(row["heading_error"] + slip, abs=1e-9)
        assert (row["path_x"], row["path_y"]) == pytest.approx((at.x, at.y), abs=1e-9)
        assert row["curvature"] == pytest.approx(at.curvature)
    gone = np.hypot(np.diff(episode["x"]), np.diff(episode["y"])).sum()
    assert episode.distance == pytest.approx(gone, rel=0.01)


def test_a_plant_sees_the_commands_in_the_record() -> None:
    path = Circle()
    episode = drive(GOOD, path, duration=5.0)
    plant, at = SimulatorConfig().make(CAR), path.at(0.0)
    first = plant.reset(Pose(at.x, at.y, at.psi), 8.0, at.curvature)
    states = [first]
    for steer, throttle, brake in zip(
        episode["steer_command"], episode["throttle"], episode["brake"], strict=True
    ):
        states.append(plant.step(Command(steer, throttle, brake)))
    assert np.array_equal(episode["x"], [s.x for s in states[:-1]])
    assert np.array_equal(episode["steer"], [s.steer for s in states[:-1]])


@pytest.mark.parametrize("answer", [math.nan, math.inf, 1.5, -1.01])
def test_unusable_steering_keeps_what_was_driven(answer: float) -> None:
    with pytest.raises(
        RunError, match=r"'Unguarded' returned steering .* at t = 0\.50 s"
    ) as caught:
        drive(Unguarded(answer=answer), Straight())
    episode = caught.value.episode
    assert episode.end == ending.ERROR
    assert len(episode) == 10
    assert episode.distance == pytest.approx(4.0, abs=0.05)


class Counting(ControllerComponent):
    """Its state changes in place, which it may."""

    def init(self, vehicle: Any, dt: float) -> list[float]:
        return []

    def decide(self, state: list[float], observation: Any) -> tuple[float, Status, list[float]]:
        state.append(observation.time)
        return 0.001 * len(state), Status.SOLVED, state


def test_asking_beforehand_leaves_no_trace() -> None:
    episode = drive(Counting(), Straight())
    assert episode["steer_command"][:3] == pytest.approx([0.001, 0.002, 0.003])


def test_controller_that_raises_keeps_what_was_driven() -> None:
    broken = Scripted(answer=ZeroDivisionError("division\n by zero"))
    with pytest.raises(RunError) as caught:
        drive(broken, Straight())
    told = (
        r"controller 'Scripted' raised ZeroDivisionError: division by zero \((.*)\), at t = 0.50 s"
    )
    place = re.fullmatch(told, str(caught.value))
    assert place is not None
    assert re.fullmatch(r"test_rollout\.py, line \d+", place.group(1))
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert len(caught.value.episode) == 10
    assert caught.value.episode.end == ending.ERROR


def test_run_keeps_the_configuration_of_a_failed_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise ArithmeticError("no")

    monkeypatch.setattr(Pid, "decide", fail)
    with pytest.raises(RunError, match="raised ArithmeticError: no") as caught:
        run(RunConfig(controller=Pid()))
    assert caught.value.episode.meta["config"]["controller"]["kind"] == "pid"


def test_controller_that_does_not_fit_says_so_itself() -> None:
    with pytest.raises(ConfigError, match="set sensor"):
        drive(Scripted(at=0, answer=ConfigError("set sensor.count")), Straight())


def test_interrupt_keeps_what_was_driven() -> None:
    with pytest.raises(Interrupted) as caught:
        drive(Scripted(answer=KeyboardInterrupt()), Straight())
    episode = caught.value.episode
    assert episode.end == ending.INTERRUPTED
    assert not episode.completed
    assert len(episode) == 10


def _answer(monkeypatch: pytest.MonkeyPatch, answer: Any) -> None:
    """Make every PID answer so from half a second on."""

    def decide(_: Pid, state: Any, observation: Observation) -> tuple[float, Status, Any]:
        if observation.time < 0.5:
            return 0.0, Status.SOLVED, state
        if isinstance(answer, BaseException):
            raise answer
        return answer, Status.SOLVED, state

    monkeypatch.setattr(Pid, "decide", decide)


@pytest.mark.parametrize(
    ("answer", "outcome", "end"),
    [
        (ValueError("no"), "controller_failed", ending.ERROR),
        (1.0, "left_road", ending.OFF_TRACK),
        (0.0, "finished", ending.DURATION),
    ],
)
def test_an_attempt_says_what_came_of_it(
    monkeypatch: pytest.MonkeyPatch, answer: Any, outcome: str, end: str
) -> None:
    _answer(monkeypatch, answer)
    tried = attempt(RunConfig(controller=Pid(), path=Straight(), duration=3.0))
    assert (tried.outcome, tried.episode.end) == (outcome, end)
    assert (tried.error is None) == (outcome != "controller_failed")
    assert tried.of_controller() is tried.episode
    assert tried.episode.meta["config"]["path"]["kind"] == "straight"


def test_an_attempt_whose_plant_fails_is_no_result_of_the_controller() -> None:
    tried = attempt(RunConfig(controller=GOOD, plant=Fragile()))
    assert tried.outcome == "plant_failed"
    with pytest.raises(PlantFailure, match="nobody answers"):
        tried.of_controller()


def test_an_interruption_is_no_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    _answer(monkeypatch, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt) as caught:
        attempt(RunConfig(controller=Pid(), path=Straight(), duration=3.0))
    assert isinstance(caught.value, Interrupted)
    assert caught.value.episode.meta["seed"] == 0


class Fragile(SimulatorConfig):
    """A plant that breaks at its tenth step, and tells whether it was closed."""

    embedded: ClassVar[bool] = False
    closed: ClassVar[list[bool]] = []

    def make(self, vehicle: Vehicle) -> Simulator:
        plant, steps, closed = super().make(vehicle), itertools.count(), self.closed
        step = plant.step

        def break_down(command: Command) -> VehicleState:
            if next(steps) == 10:
                raise PlantError("nobody answers")
            return step(command)

        plant.step = break_down  # type: ignore[method-assign]
        plant.close = lambda: closed.append(True)  # type: ignore[method-assign]
        return plant


def test_plant_that_fails_keeps_what_was_driven_and_is_closed() -> None:
    Fragile.closed.clear()
    config = RunConfig(controller=GOOD, plant=Fragile())
    with pytest.raises(PlantFailure, match=r"^nobody answers, at t = 0\.50 s$") as caught:
        run(config)
    episode = caught.value.episode
    assert episode.end == ending.ERROR
    assert len(episode) == 11
    assert episode.meta["config"]["controller"]["kind"] == "pid"
    assert Fragile.closed == [True]


class Compiling(Scripted):
    """Takes long at its first and, by another way through the code, at its second step ever."""

    compiled: ClassVar[set[int]] = set()

    def decide(self, state: int, observation: Observation) -> tuple[float, Status, int]:
        if state < 2 and state not in self.compiled:
            self.compiled.add(state)
            time.sleep(0.2)
        return 0.0, Status.SOLVED, state + 1


def test_no_computing_time_holds_compilation() -> None:
    Compiling.compiled.clear()
    episode = drive(Compiling(), Straight(), duration=0.3)
    assert Compiling.compiled == {0, 1}
    assert episode["control_time"].max() < 0.15


@pytest.mark.parametrize("at", [0, 2])
def test_a_controller_that_fails_early_fails_at_its_step(at: int) -> None:
    with pytest.raises(RunError, match=f"at t = {0.05 * at:.2f} s") as caught:
        drive(Scripted(at=at, answer=ValueError("no")), Straight())
    assert len(caught.value.episode) == at


@pytest.mark.parametrize("path", [Straight(distance=200.0), Circle()])
def test_a_start_beyond_the_path_is_refused(path: PathComponent) -> None:
    with pytest.raises(ConfigError, match=rf"start: .* is not allowed.*{path.length:g} \[m\]"):
        drive(GOOD, path, start=Start(s=path.length))


def test_laps_of_an_open_path_are_refused() -> None:
    with pytest.raises(ConfigError, match="laps"):
        drive(GOOD, Straight(), laps=1.0)


def test_duration_and_laps_exclude_each_other() -> None:
    with pytest.raises(ValueError, match="laps or duration"):
        RunConfig(duration=1.0, laps=1.0)


def test_run_is_rollout_with_a_record_of_its_configuration() -> None:
    config = RunConfig(controller=GOOD, speed=ConstantSpeed(speed=8.0), duration=2.0, seed=3)
    episode = run(config)
    assert same(episode, drive(GOOD, Circle(), duration=2.0, seed=3))
    assert RunConfig.model_validate(episode.meta["config"]) == config
    assert episode.meta["seed"] == 3
    assert "steersman" in episode.meta["versions"]


def test_progress_is_told() -> None:
    shares: list[float] = []
    run(RunConfig(controller=GOOD, duration=20.0), shares.append)
    assert shares == pytest.approx([0.25, 0.5, 0.75, 1.0])


@pytest.mark.parametrize("redraw", [True, False])
def test_waypoint_errors_are_seen_not_recorded(redraw: bool) -> None:
    """Errors of the sensor mislead the controller, never the record."""
    sensor = WaypointSensor(error_range=0.3, redraw=redraw)
    episode = drive(GOOD, Circle(), sensor=sensor, duration=5.0, seed=1)
    path = Circle()
    k = len(episode) // 2
    _, d = path.project(episode["x"][k], episode["y"][k])
    assert episode["lateral_error"][k] == pytest.approx(d, abs=1e-9)
    assert np.std(np.diff(episode["steer_command"])) > 1e-4 or not redraw


def test_a_model_based_controller_steers_by_the_nominal_vehicle() -> None:
    """Wrong parameters reach the controller and not the car."""
    words = {"path": {"kind": "circle"}, "speed": ConstantSpeed(speed=15.0), "duration": 3.0}
    wrong = CAR.replace(c_f=0.7 * CAR.c_f, c_r=1.3 * CAR.c_r)
    for controller in (GOOD, MpcPid()):
        right = run(RunConfig(controller=controller, **words))
        told = run(RunConfig(controller=controller, nominal=wrong, **words))
        assert not same(right, told)
        assert same(right, run(RunConfig(controller=controller, nominal=CAR, **words)))
    blind = Pid(gains=GOOD.gains)
    assert same(
        run(RunConfig(controller=blind, **words)),
        run(RunConfig(controller=blind, nominal=wrong, **words)),
    )


def test_a_wrong_model_in_the_controller_is_the_same_as_a_wrong_nominal_vehicle() -> None:
    words = {"speed": ConstantSpeed(speed=12.0), "duration": 2.0}
    error = {"mass": 1.3, "c_r": 0.7}
    inside = run(RunConfig(controller={"kind": "mpc_pid", "model_error": error}, **words))
    nominal = CAR.replace(mass=1.3 * CAR.mass, c_r=0.7 * CAR.c_r)
    assert same(inside, run(RunConfig(controller=MpcPid(), nominal=nominal, **words)))


@pytest.mark.parametrize(
    ("length", "end"),
    [({"duration": 1.0}, ending.DURATION), ({"laps": 1.0}, ending.TIMEOUT)],
)
def test_only_what_was_not_planned_is_a_timeout(
    monkeypatch: pytest.MonkeyPatch, length: dict[str, float], end: str
) -> None:
    """Also where the planned time is that from which a lap is given up."""
    monkeypatch.setattr("steersman.run_length.LONGEST", 1.0)
    episode = run(RunConfig(controller=GOOD, path=Circle(), **length))
    assert (episode.end, episode.completed) == (end, "duration" in length)


@pytest.mark.parametrize(
    ("controller", "vehicle"),
    [
        ({"kind": "mpc_delay"}, {"kind": "carla_model3", "c_r": 5e-324}),
        ({"kind": "mpc_delay", "q_yaw_rate": 2.0**63}, {"kind": "carla_model3"}),
        ({"kind": "supervisor", "inner": "mpc_delay"}, {"kind": "carla_model3", "c_r": 5e-324}),
    ],
)
def test_a_design_without_a_solution_is_the_configurations_fault(
    controller: dict[str, Any], vehicle: dict[str, Any]
) -> None:
    config = RunConfig.model_validate({"controller": controller, "vehicle": vehicle, "duration": 1})
    with pytest.raises(ConfigError, match="finds no solution for this vehicle"):
        run(config)


def test_a_long_drive_waits_in_a_file_and_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    config = RunConfig(duration=3.0, plant=SimulatorConfig(record=True))
    kept = run(config)
    monkeypatch.setattr(rollout, "IN_MEMORY", 1000)
    monkeypatch.setattr(rollout, "BLOCK", 7)
    streamed = run(config)
    assert len(kept.fine) > len(kept) == 60
    assert np.array_equal(streamed.fine, kept.fine)
    for name in set(kept.columns) - {"control_time"}:
        assert np.array_equal(streamed[name], kept[name]), name
