"""Checks of a CARLA server: faults of it or of the assumed vehicle, and their cures."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from steersman.errors import PlantError
from steersman.paths.analytic import Circle
from steersman.plants.carla import CarlaConfig
from steersman.plants.carla_plant import CarlaPlant
from steersman.plants.carla_server import whose
from steersman.plants.carla_session import ROLE, Session
from steersman.types import Command, Pose, VehicleState
from steersman.vehicles import Vehicle

# Blueprints whose figures the package has, too.
KNOWN = {
    "vehicle.tesla.model3": "carla_model3",
    "vehicle.lincoln.mkz_2020": "carla_mkz2020",
}
# The test drive: its road and speed, the time to look at it [s], and the steady steering.
_RADIUS, _SPEED, _SECONDS = 50.0, 8.0, 4.0
# Runs that differ by more are not repeatable [m].
_REPEATS = 1e-3
# A car that does not gain so much in two seconds of throttle 0.6 does not take off [m/s].
_TAKES_OFF = 2.0
# The steering law may be wrong by so much of the wheel's angle.
_LAW = 0.03
# So much less than real time is slow [1/s] times the period.
_SLOW = 1.0


class Finding(NamedTuple):
    """One thing that was looked at."""

    name: str
    healthy: bool
    text: str
    cure: str = ""
    """What to do about it; the text may say so itself."""


def examine(config: CarlaConfig, vehicle: Vehicle, *, clean: bool = False) -> Iterator[Finding]:
    """Look at a server from the outside in; what cannot be looked at after a fault is left out.

    A test drive replaces the world by a circle, unless ``config.map`` names one. It is not driven
    while vehicles of others stand there.

    Args:
        config: the server and what is to be driven there.
        vehicle: the vehicle that is assumed.
        clean: destroy all vehicles, those of other clients too.

    Raises:
        ModuleNotFoundError: the client is not installed.
    """
    session = config.session()
    try:
        session.open(aloud=False)
    except PlantError as error:
        session.close()
        yield Finding("connection", False, str(error))
        return
    try:
        yield Finding("connection", True, f"{session.server}: {whose(session.version)}")
        yield _settings(session)
        others = _others(session, clean)
        yield others
        if config.map is not None:
            session.load(config.map)
            text = f"{config.map} is there; a test drive is made without plant.map only"
            yield Finding("map", True, text)
        elif others.healthy:
            yield from _test_drive(config, vehicle, session)
    except PlantError as error:
        yield Finding("test drive", False, str(error))
    finally:
        session.close()


def _settings(session: Session) -> Finding:
    if session.notes:
        return Finding("settings", True, "; ".join(session.notes))
    return Finding("settings", True, "asynchronous mode, as it should be without a client")


def _others(session: Session, clean: bool) -> Finding:
    """Vehicles that are not ours; ours are gone by now."""
    session.remove_leftovers()
    session.tick()
    found = list(session.world.get_actors().filter("vehicle.*"))
    found = [actor for actor in found if actor.attributes.get("role_name") != ROLE]
    if not found:
        return Finding("vehicles", True, "none on the map")
    shown = ", ".join(f"{actor.id} {actor.type_id}" for actor in found[:5])
    if clean:
        session.send([session.lib.command.DestroyActor(actor.id) for actor in found])
        session.tick()
        return Finding("vehicles", True, f"{len(found)} destroyed: {shown}")
    return Finding(
        "vehicles",
        False,
        f"{len(found)} on the map that are not ours: {shown}; no test drive was made",
        "stop the client they belong to, or destroy them: steersman carla doctor --clean",
    )


def _test_drive(config: CarlaConfig, vehicle: Vehicle, session: Session) -> Iterator[Finding]:
    plant = CarlaPlant(config, vehicle, session)
    path = Circle(radius=_RADIUS)
    plant.enter(path)
    at = path.at(0.0)
    start = Pose(at.x, at.y, at.psi)
    first = plant.reset(start, 0.0, 0.0)
    yield _vehicle(config, vehicle, plant.reported)
    yield _takes_off(plant, first)
    begun = time.perf_counter()
    one, other = _drive(plant, start), _drive(plant, start)
    took = (time.perf_counter() - begun) / (2 * len(one.states))
    yield _steering(plant, one)
    yield _velocity(plant, one.states)
    yield _repeats(one.states, other.states)
    rate, needed = 1.0 / took, _SLOW / config.dt
    yield Finding(
        "speed",
        rate > needed,
        f"{rate:.0f} control steps/s, {rate * config.dt:.1f} times real time",
        "" if rate > needed else "plant.rendering=false, or start CARLA with -quality-level=Low",
    )


def _vehicle(config: CarlaConfig, given: Vehicle, reported: Vehicle) -> Finding:
    """Figures in which the server differs, and the source of those that it does not give."""
    other = _differences(given, reported)
    text = f"{config.vehicle}: " + (f"the server gives {other}" if other else "as assumed")
    known = KNOWN.get(config.vehicle)
    if known is not None and given.kind in KNOWN.values() and given.kind != known:
        text += f"; stiffnesses, yaw inertia and throttle map are {given.kind}'s"
        return Finding("vehicle", False, text, f"vehicle={known}, or steersman carla calibrate")
    if other and not config.read_physics:
        cure = "plant.read_physics=true, or the vehicle file of this car"
        return Finding("vehicle", False, f"{text}, and plant.read_physics=false ignores it", cure)
    return Finding("vehicle", True, text)


def _differences(given: Vehicle, found: Vehicle) -> str:
    """Figures in which the server differs; empty if none."""
    names = [
        f"{name} {getattr(found, name):.4g} (not {getattr(given, name):.4g})"
        for name in ("mass", "l_f", "l_r", "track_width", "max_wheel_angle", "friction")
        if not math.isclose(getattr(given, name), getattr(found, name), rel_tol=1e-3)
    ]
    if found.steer_curve_factor != given.steer_curve_factor:
        names.append("another steering curve")
    return ", ".join(names)


def _takes_off(plant: CarlaPlant, state: VehicleState) -> Finding:
    for _ in range(round(2.0 / plant.dt)):
        state = plant.step(Command(0.0, 0.6, 0.0))
    gained = math.hypot(state.v_x, state.v_y)
    text = f"{gained:.1f} m/s after 2 s of throttle 0.6"
    return Finding(
        "take-off",
        gained > _TAKES_OFF,
        text,
        "" if gained > _TAKES_OFF else "give it longer after spawning: plant.warm_up=4",
    )


class _Run(NamedTuple):
    """A drive, and the steering command that was held before it."""

    held: float
    states: list[VehicleState]


def _drive(plant: CarlaPlant, start: Pose) -> _Run:
    """The same commands every time: the steady turn's, with a wave on the steering."""
    states = [plant.reset(start, _SPEED, 1.0 / _RADIUS)]
    held, first = plant.held_steer, states[0]
    for k in range(round(_SECONDS / plant.dt)):
        wave = 0.02 * math.sin(math.tau * k * plant.dt)
        states.append(plant.step(Command(first.steer + wave, 0.45, 0.0)))
    return _Run(held, states)


def _steering(plant: CarlaPlant, run: _Run) -> Finding:
    """Whether the wheels stand where the steering law has them, at the start of the run."""
    first = run.states[0]
    there = plant.vehicle.steer_for_wheel_angle(first.wheel_angle, first.v_x)
    wrong = abs(there - run.held) / max(abs(run.held), 1e-9)
    return Finding(
        "steering law",
        wrong < _LAW,
        f"wheels at {math.degrees(first.wheel_angle):.2f} deg, {100.0 * wrong:.1f} % off the law",
        "" if wrong < _LAW else "fit it: steersman carla calibrate --out vehicle.yaml",
    )


def _velocity(plant: CarlaPlant, states: list[VehicleState]) -> Finding:
    """The point whose velocity the server gives: the centre of mass, or of the actor's origin."""
    at_centre = at_origin = 0.0
    for before, after in pairwise(states):
        psi = 0.5 * (before.psi + after.psi)
        rate = 0.5 * (before.yaw_rate + after.yaw_rate)
        x, y = (after.x - before.x) / plant.dt, (after.y - before.y) / plant.dt
        side = -math.sin(psi) * x + math.cos(psi) * y
        told = 0.5 * (before.v_y + after.v_y)
        at_centre += (told - side) ** 2
        at_origin += (told + rate * plant.ahead - side) ** 2
    healthy = at_centre <= at_origin
    return Finding(
        "velocity",
        healthy,
        "of the centre of mass, as assumed" if healthy else "of the actor's origin, it seems",
        "" if healthy else "side velocities are off by yaw rate x 0.45 m or so; please report it",
    )


def _repeats(one: list[VehicleState], other: list[VehicleState]) -> Finding:
    apart = max(math.hypot(a.x - b.x, a.y - b.y) for a, b in zip(one, other, strict=True))
    healthy = apart < _REPEATS
    return Finding(
        "repeatability",
        healthy,
        f"the same commands twice: {1e3 * apart:.3g} mm apart after {_SECONDS:g} s at most",
        ""
        if healthy
        else "nothing else may run on the server; restart it; compare means over several runs",
    )
