"""Figures of the controllers: what their gains do, and what they cannot do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from closed_loops import back_to_the_road, drive, responses

from steersman.config import build
from steersman.controllers.adjustment import Adjuster, adjustments
from steersman.controllers.base import ControllerComponent
from steersman.controllers.lqr import Lqr
from steersman.controllers.supervisor import Supervisor
from steersman.paths.analytic import Circle, DoubleLaneChange, FigureEight
from steersman.paths.generated import ClothoidRoad
from steersman.rollout import RunConfig, attempt
from steersman.sensing import WaypointSensor
from steersman.speed import ConstantSpeed
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle


def over_time(
    title: str,
    episodes: Mapping[str, Any],
    column: str = "lateral_error",
    label: str = "lateral error [m]",
    factor: float = 1.0,
) -> dict[str, Any]:
    """A column of drives over time, times ``factor``: a line for each."""
    lines = [
        {"name": name, "x": episode["time"], "y": factor * episode[column]}
        for name, episode in episodes.items()
    ]
    return {"title": title, "x": "time [s]", "y": label, "lines": lines}


def pid() -> dict[str, Any]:
    """The derivative damps."""
    gains = {"k_p": 0.1, "k_i": 0.0}
    return responses(
        "PID from 0.5 m beside the road, 10 m/s, k_p = 0.1 1/m",
        {
            f"k_d = {k_d} s/m": {"kind": "pid", "gains": {**gains, "k_d": k_d}}
            for k_d in (0.0, 0.02, 0.05)
        },
        seconds=6.0,
    )


def pid_feedforward() -> dict[str, Any]:
    """The steady turn's steering, or an integral that has to find it."""
    controllers = {
        "PID": {"kind": "pid"},
        "PID with feed-forward": {"kind": "pid", "feedforward": True},
    }
    return over_time(
        "Figure-eight at 8 m/s",
        {n: drive(c, FigureEight(), 8.0, seconds=30.0) for n, c in controllers.items()},
    )


def bearing_pid() -> dict[str, Any]:
    """A point ahead is no point on the road."""
    return over_time(
        "PID on the bearing (CARLA's gains), figure-eight",
        {
            f"{speed:.0f} m/s": drive("bearing_pid", FigureEight(), speed, seconds=24.0)
            for speed in (5.0, 8.0, 11.0)
        },
    )


def pure_pursuit() -> dict[str, Any]:
    """The look-ahead decides; the linear theory with each."""
    figure = responses(
        "Pure pursuit from 0.5 m beside the road, 5 m/s",
        {
            f"look-ahead {ahead:.0f} m": {
                "kind": "pure_pursuit",
                "look_ahead_time": 0.0,
                "look_ahead_offset": ahead,
            }
            for ahead in (4.0, 8.0, 16.0)
        },
        speed=5.0,
        seconds=10.0,
    )
    time = figure["lines"][0]["x"]
    rate = 5.0 / 8.0
    theory = 0.5 * np.exp(-rate * time) * (np.cos(rate * time) + np.sin(rate * time))
    figure["lines"].append({"name": "linear theory, 8 m", "x": time, "y": theory})
    return figure


def pure_pursuit_corner() -> dict[str, Any]:
    """A long look-ahead cuts corners."""
    fields = {"kind": "pure_pursuit", "look_ahead_time": 0.0}
    return over_time(
        "Pure pursuit, figure-eight at 5 m/s, error of the centre of mass",
        {
            f"look-ahead {ahead:.0f} m": drive(
                {**fields, "look_ahead_offset": ahead}, FigureEight(), 5.0, seconds=30.0
            )
            for ahead in (4.0, 8.0, 16.0)
        },
    )


def stanley() -> dict[str, Any]:
    """Small errors decay at the rate gain v / (softening + v)."""
    figure = responses(
        "Stanley from 0.5 m beside the road, 10 m/s",
        {f"gain {gain} 1/s": {"kind": "stanley", "gain": gain} for gain in (0.75, 1.5, 3.0)},
        seconds=5.0,
    )
    time = figure["lines"][0]["x"]
    theory = 0.5 * np.exp(-1.5 * 10.0 / 11.0 * time)
    figure["lines"].append({"name": "linear theory, 1.5 1/s", "x": time, "y": theory})
    return figure


def lqr() -> dict[str, Any]:
    """Error against steering, by one weight."""
    return responses(
        "LQR from 0.5 m beside the road, 10 m/s",
        {f"q_lateral = {q} 1/m^2": {"kind": "lqr", "q_lateral": q} for q in (0.1, 1.0, 10.0)},
    )


def lqr_gains() -> dict[str, Any]:
    """The gains over speed."""
    from steersman.controllers.lqr import Lqr, gain_at
    from steersman.vehicles import CarlaModel3

    state = Lqr().init(CarlaModel3(), 0.05)
    speeds = np.linspace(1.0, 40.0, 118)
    gains = np.array([gain_at(state.gains, v) for v in speeds])
    names = ("k1, of e1 [rad/m]", "k2, of e1' [rad s/m]", "k3, of e2 [-]", "k4, of e2' [s]")
    lines = [{"name": n, "x": speeds, "y": gains[:, i]} for i, n in enumerate(names)]
    title = "LQR's gains over speed, default weights"
    return {"title": title, "x": "speed [m/s]", "y": "gain", "lines": lines}


def sliding_mode() -> dict[str, Any]:
    """The slope of the surface is the rate of decay."""
    return responses(
        "Sliding mode from 0.5 m beside the road, 10 m/s",
        {f"slope {c} 1/s": {"kind": "sliding_mode", "slope": c} for c in (0.5, 1.0, 2.0)},
        seconds=6.0,
    )


def mpc_price() -> dict[str, Any]:
    """The price of steering in the linear MPC."""
    return responses(
        "Linear MPC from 0.5 m beside the road, 10 m/s",
        {f"r = {r} 1/rad^2": {"kind": "mpc", "r": r} for r in (1.0, 30.0, 100.0, 300.0)},
        seconds=5.0,
    )


def mpc_pid_speed() -> dict[str, Any]:
    """One model for all speeds, or a model for each."""
    controllers = {
        "one model, 30 km/h": {"kind": "mpc_pid"},
        "a model for each speed": {"kind": "mpc_pid", "scheduled": True},
    }
    episodes = {
        f"{name}, {speed:.0f} m/s": drive(fields, Circle(), speed, seconds=10.0)
        for name, fields in controllers.items()
        for speed in (8.0, 16.0)
    }
    title = "MPC-PID on the circle of 50 m"
    return over_time(title, episodes, label="lateral error [mm]", factor=1e3)


def _late(controllers: Mapping[str, Any]) -> dict[str, Any]:
    """The figure-eight with 0.2 s of steering delay."""
    return over_time(
        "Steering that acts 0.2 s late, figure-eight at 8 m/s",
        {n: drive(c, FigureEight(), 8.0, seconds=20.0, delay=0.2) for n, c in controllers.items()},
    )


def mpc_delay() -> dict[str, Any]:
    """What 0.2 s of steering delay does, and what knowing it is worth."""
    return _late(
        {
            "mpc_delay, delay found": {"kind": "mpc_delay"},
            "mpc_delay, delay given": {"kind": "mpc_delay", "delay": 0.2},
            "lqr, without a model of it": {"kind": "lqr"},
        }
    )


def mpc_delay_noise() -> dict[str, Any]:
    """What the estimator takes out of the steering on a noisy road."""
    noisy, alone = WaypointSensor(error_range=0.1), {"kind": "mpc_delay"}
    controllers = {
        "mpc_delay alone": alone,
        "mpc_delay behind the estimator": {"kind": "estimated", "controller": alone},
    }
    episodes = {
        name: drive(controller, DoubleLaneChange(), 10.0, sensor=noisy)
        for name, controller in controllers.items()
    }
    title = "Waypoints shifted by up to 0.1 m: double lane change at 10 m/s"
    return over_time(title, episodes, "steer_command", "steering command [-]")


def predicted() -> dict[str, Any]:
    """What the predictor makes of LQR under 0.2 s of steering delay."""
    alone = {"kind": "lqr"}
    behind = {"kind": "estimated", "estimator": None, "predictor": "single_track"}
    return _late({"lqr": alone, "lqr behind the predictor": {**behind, "controller": alone}})


def nmpc() -> dict[str, Any]:
    """What a plan with limited tyres is worth where the car has less grip than is known."""
    controllers = {
        "nmpc": {"kind": "nmpc"},
        "mpc_delay, friction not estimated": {"kind": "mpc_delay", "estimate_friction": False},
        "lqr": {"kind": "lqr"},
    }
    return over_time(
        "Figure-eight at 10.5 m/s, friction 0.5 where 3.0 is nominal",
        {
            n: drive(c, FigureEight(), 10.5, seconds=20.0, friction=0.5)
            for n, c in controllers.items()
        },
    )


def policy_trim() -> dict[str, Any]:
    """The integral loop around the network."""
    episodes = {
        name: drive({"kind": "policy", "trim": trim}, Circle(), 18.0, seconds=30.0)
        for name, trim in (("trim 0", 0.0), ("trim as its card says", None))
    }
    title = "The packaged policy on the circle of 50 m, 18 m/s"
    return over_time(title, episodes, label="lateral error [mm]", factor=1e3)


class Switched(ControllerComponent):
    """LQR whose price of steering is an action: one until a moment, then the other."""

    family: ClassVar[str] = "controller"  # not registered: it serves this figure alone
    kind: ClassVar[str] = "switched"

    first: float = -1.0
    then: float = -1.0
    moment: float = 1.0

    def init(self, vehicle: Vehicle, dt: float) -> Any:
        """Not adjusted yet, and what adjusts it."""
        adjuster = Adjuster(Lqr(), adjustments(Lqr(), {"r": "0.1..100:log"}), vehicle, dt)
        return adjuster, adjuster.begin()

    def decide(self, state: Any, observation: Observation) -> tuple[float, Status, Any]:
        """The regulator's steering under the present action."""
        adjuster, now = state
        action = self.first if observation.time < self.moment else self.then
        decision, now = adjuster.adjust(now, np.array([action])).step(observation)
        return decision.steer, decision.status, (adjuster, now)


def adjusted() -> dict[str, Any]:
    """The way back to the road under both bounds of a parameter, and with a change between them."""
    drivers = {
        "r = 0.1, action -1": Switched(),
        "r = 100, action 1": Switched(first=1.0, then=1.0),
        "r = 100, after 1 s 0.1": Switched(first=1.0),
    }
    title = "LQR from 0.5 m beside the road at 10 m/s, r between 0.1 and 100"
    return responses(title, drivers)


class Stuck(ControllerComponent):
    """Steers as LQR does, and from a moment on repeats its last command, marked as solved."""

    family: ClassVar[str] = "controller"  # not registered: it serves this figure alone
    kind: ClassVar[str] = "stuck"

    moment: float = 3.0

    def init(self, vehicle: Vehicle, dt: float) -> Any:
        """State before the first step, and no command yet."""
        return Lqr().init(vehicle, dt), 0.0

    def decide(self, state: Any, observation: Observation) -> tuple[float, Status, Any]:
        """The regulator's steering, or the last one."""
        inner, last = state
        if observation.time >= self.moment:
            return last, Status.SOLVED, state
        steer, status, inner = Lqr().decide(inner, observation)
        return steer, status, (inner, steer)


def supervisor() -> dict[str, Any]:
    """A controller that gets stuck on a bend, alone and supervised."""
    return over_time(
        "The controller's command gets stuck at the entry of a bend, figure-eight at 8 m/s",
        {
            name: drive(controller, FigureEight(), 8.0, seconds=10.0)
            for name, controller in (("alone", Stuck()), ("supervised", Supervisor(inner=Stuck())))
        },
    )


def everybody() -> dict[str, Any]:
    """Every tuned controller's way back to the road."""
    from steersman import core_yaml, tuned

    lines = []
    for name in ("pid", "pure_pursuit", "stanley", "lqr", "sliding_mode", "mpc_pid", "mpc_delay"):
        file = tuned.locate(f"tuned/{name}")
        assert file is not None
        fields = core_yaml.load(file.read_text(encoding="utf-8"))["controller"]
        time, error = back_to_the_road(fields)
        lines.append({"name": name, "x": time, "y": error})
    title = "From 0.5 m beside the road at 10 m/s, gains of tuned/"
    return {"title": title, "x": "time [s]", "y": "lateral error [m]", "lines": lines}


def grip_speed() -> dict[str, Any]:
    """A slippery road makes bends slow, and the ways into and out of them long."""
    road, lines = ClothoidRoad(seed=3, distance=300.0), []
    for friction in (1.0, 0.5, 0.3):
        controller = {"kind": "grip_speed", "inner": "tuned/lqr", "friction": friction}
        sensor, wished = WaypointSensor(count=25), ConstantSpeed(speed=20.0)
        episode = drive(controller, road, speed=wished, sensor=sensor)
        lines.append({"name": f"friction {friction:g}", "x": episode["s"], "y": episode["v_x"]})
    title = "Speed on one road where 20 m/s are wished, by the friction that is reckoned with"
    return {"title": title, "x": "arc length [m]", "y": "speed [m/s]", "lines": lines}


def joint_nmpc() -> dict[str, Any]:
    """One plan of both, beside a speed limit around a controller that steers."""
    road, lines = ClothoidRoad(seed=3, distance=300.0), []
    car = {"kind": "carla_model3", "friction": 0.4}
    for name, controller in {
        "joint_nmpc": {"kind": "joint_nmpc"},
        "grip_speed around nmpc": {"kind": "grip_speed", "inner": "tuned/nmpc"},
        "joint_nmpc, friction found": {"kind": "joint_nmpc", "found": True},
    }.items():
        words = {
            "controller": controller,
            "path": road,
            "speed": {"kind": "profile", "start": 0.0, "top": 20.0, "a_lat_max": 30.0},
            "vehicle": car,
            "nominal": "carla_model3" if "found" in controller else car,
            "sensor": {"kind": "waypoints", "count": 41},
        }
        episode = attempt(build(RunConfig, words)).episode
        lines.append({"name": name, "x": episode["s"], "y": episode["v_x"]})
    title = "Speed on ice (friction 0.4), where 20 m/s are wished"
    return {"title": title, "x": "arc length [m]", "y": "speed [m/s]", "lines": lines}


def time_gap() -> dict[str, Any]:
    """Behind a car that brakes and speeds up, with two sets of gains."""
    trace = {
        "kind": "random_profile", "low": 3.0, "high": 25.0, "interval": 4.0, "change": 2.5,
        "seed": 3,
    }  # fmt: skip
    lines = []
    for k_gap, k_speed in ((0.2, 0.7), (0.05, 0.3)):
        words = {
            "controller": {"kind": "time_gap", "k_gap": k_gap, "k_speed": k_speed},
            "path": {"kind": "circle", "radius": 400.0},
            "speed": {"kind": "constant_speed", "speed": 33.0},
            "lead": {"speed": trace},
            "duration": 60.0,
        }
        found = attempt(build(RunConfig, words)).episode
        name, error = (
            f"k_gap {k_gap:g}, k_speed {k_speed:g}",
            found["gap"] - 3.0 - 1.5 * found["v_x"],
        )
        lines.append({"name": name, "x": found["time"], "y": error})
    title = "Gap less the wished one, behind a car whose speed changes by up to 2.5 m/s^2"
    return {"title": title, "x": "time [s]", "y": "error of the gap [m]", "lines": lines}


FIGURES = {
    "time_gap": time_gap,
    "grip_speed": grip_speed,
    "joint_nmpc": joint_nmpc,
    "pid": pid,
    "pid_feedforward": pid_feedforward,
    "bearing_pid": bearing_pid,
    "pure_pursuit": pure_pursuit,
    "pure_pursuit_corner": pure_pursuit_corner,
    "stanley": stanley,
    "lqr": lqr,
    "lqr_gains": lqr_gains,
    "sliding_mode": sliding_mode,
    "mpc_price": mpc_price,
    "mpc_pid_speed": mpc_pid_speed,
    "mpc_delay": mpc_delay,
    "mpc_delay_noise": mpc_delay_noise,
    "predicted": predicted,
    "nmpc": nmpc,
    "policy_trim": policy_trim,
    "adjusted": adjusted,
    "supervisor": supervisor,
    "everybody": everybody,
}
