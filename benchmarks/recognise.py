"""Does the embedded Model 3 move as that of a real CARLA server does? Fit, validation, tables.

    python benchmarks/recognise.py --carla-logs DIR                       # compares; JSON on stdout
    python benchmarks/recognise.py --carla-logs DIR --fit --out results/recognise

DIR holds logs of a synchronous client at 20 Hz as CSV: time, x, y, yaw (CARLA's axes, rad), speed,
steer_normalized (right positive), throttle, brake; other files are left out. A row is the state at
the beginning of a tick and the command that acts in it.

A replay drives the recorded commands in stretches of 2 s, each from the recorded state (side-slip
from positions and yaw), at the recorded speed; actuators run through from the log's beginning.
Residuals are those of the yaw rate as a mean over the tick, so exactly what the log holds. The fit
weighs the speeds by their targets, with a loss that outliers do not rule (soft L1). Validation fits
without one log and judges on it; intervals (95 %) are the jackknife's over logs. Profiles hold one
figure and fit the others.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

import steersman as sm
from steersman.files import make_folder, write_text
from steersman.kernels import vehicle as car
from steersman.kernels.recorded_response import replay
from steersman.kernels.steady_turn import steady_turn
from steersman.provenance import provenance
from steersman.report.svg import LinePlot, PlotLine
from steersman.vehicles import LONGEST_STEP, Vehicle

DT, H = 0.05, LONGEST_STEP
STEPS = round(DT / H)
STRETCH = 40
"""Ticks of a stretch: 2 s."""
# The first two seconds: the launch, and the wheels' straightening.
_LAUNCH = 40
# Centre of mass ahead of the actor's origin [m], and axles from the origin [m]; CARLA's blueprint.
ORIGIN, FRONT, REAR = 0.45, 1.618, 1.386
TARGETS = {5.0: 0.005, 10.0: 0.010, 15.0: 0.030}
"""Residual of the yaw rate at each speed [rad/s]."""
_SIDE_WEIGHT = 0.1
_SOFT = 0.05
# A place of the map where logs of different drives have residuals so large [rad/s], so near [m].
_PEAK, _NEAR = 0.04, 8.0
_COLUMNS = ("time", "x", "y", "yaw", "speed", "steer_normalized", "throttle", "brake")


class Drive(NamedTuple):
    """A log: states every ``H`` for the replay, and what it is compared with."""

    name: str
    speed: float
    """Wished speed [m/s]."""
    position: Any
    """(n, 2) of the actor's origin [m], y left."""
    yaw: Any
    velocity: Any
    """(n, 3) speed ahead and to the left of the origin [m/s], yaw rate [rad/s]."""
    measured_speed: Any
    command: Any
    """(n, 3) steering, left positive, throttle, brake."""
    a_x: Any


def _slope(values: Any) -> Any:
    """Derivative by five points."""
    out = np.gradient(values, DT)
    out[2:-2] = (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / (12 * DT)
    return out


def read(file: Path) -> Drive | None:
    """The log of a file; None if the file is none."""
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows or not set(_COLUMNS) <= set(rows[0]):
        return None
    column = {name: np.array([float(row[name]) for row in rows]) for name in _COLUMNS}
    if not np.allclose(np.diff(column["time"]), DT, atol=1e-3):
        raise SystemExit(f"{file}: rows must be {DT} s apart")
    x, y, yaw = column["x"], -column["y"], -np.unwrap(column["yaw"])
    c, s, v_x, v_y = np.cos(yaw), np.sin(yaw), _slope(x), _slope(y)
    ahead, left, rate = c * v_x + s * v_y, c * v_y - s * v_x, _slope(yaw)
    command = np.column_stack([-column["steer_normalized"], column["throttle"], column["brake"]])
    wished = min(TARGETS, key=lambda v: abs(v - float(np.median(column["speed"][_LAUNCH:]))))
    return Drive(
        file.stem, wished, np.column_stack([x, y]), yaw, np.column_stack([ahead, left, rate]),
        column["speed"], command, _slope(ahead) - left * rate,
    )  # fmt: skip


def states(vehicle: Vehicle, drive: Drive, origin: float, *, held: bool) -> tuple[Any, Any]:
    """Replayed states at the beginning and at the end of each tick, (n - 1, N_STATE) each."""
    ticks = len(drive.yaw) - 1
    command = np.repeat(drive.command[:-1], STEPS, axis=0)
    base = np.zeros((ticks * STEPS + 1, car.N_STATE))
    work = np.zeros((3, car.N_MOTION))
    whole, out = np.zeros(1, dtype=np.int64), np.zeros_like(base)
    replay(vehicle.table, command, whole, base, True, H, out, work)
    base[:, car.STEER : car.BRAKE + 1] = out[:, car.STEER : car.BRAKE + 1]
    at, grid = np.arange(ticks + 1) * STEPS, np.arange(ticks * STEPS + 1)
    ahead, left, rate = drive.velocity.T
    for column, values in (
        (car.VX, ahead),
        (car.VY, left + origin * rate),
        (car.YAW_RATE, rate),
        (car.PSI, drive.yaw),
        (car.LOAD_AX, drive.a_x),
        (car.LOAD_AY, ahead * rate),
    ):
        base[:, column] = np.interp(grid, at, values)
    starts = np.concatenate([whole, np.arange(_LAUNCH, ticks, STRETCH) * STEPS])
    replay(vehicle.table, command, starts, base, held, H, out, work)
    return out[at[:-1]], out[at[1:]]


def kept(drive: Drive) -> Any:
    """Ticks that are compared: after the launch, but for the last of a stretch."""
    ticks = np.arange(_LAUNCH, len(drive.yaw) - 2)
    return ticks[(ticks + 1 - _LAUNCH) % STRETCH != 0]


class Residual(NamedTuple):
    """Replay minus log, for each tick of :func:`kept`."""

    yaw_rate: Any
    """Mean over the tick [rad/s]."""
    recorded: Any
    """The log's own."""
    slope: Any
    """And its slope [rad/s^2]."""
    side: Any
    """Speed of the origin to the left [m/s]."""
    speed: Any
    """Speed ahead [m/s]; nothing if held."""


def residual(
    vehicle: Vehicle,
    drive: Drive,
    *,
    origin: float = ORIGIN,
    lead: float = 0.0,
    held: bool = True,
) -> Residual:
    """Of one log; ``lead`` [s] is how far the recorded yaw runs ahead of the rate's integral."""
    begin, end = states(vehicle, drive, origin, held=held)
    gained = end[:, car.PSI] - begin[:, car.PSI]
    gained += lead * (end[:, car.YAW_RATE] - begin[:, car.YAW_RATE])
    recorded = np.diff(drive.yaw) / DT
    side = begin[:, car.VY] - origin * begin[:, car.YAW_RATE] - drive.velocity[:-1, 1]
    speed = begin[:, car.VX] - drive.velocity[:-1, 0]
    columns = gained / DT - recorded, recorded, np.gradient(recorded, DT), side, speed
    return Residual(*(column[kept(drive)] for column in columns))


def rms(values: Any) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def lag(found: Residual) -> float:
    """Time by which the replay is late [s]: the residual's part along the recorded slope."""
    return -float(found.yaw_rate @ found.slope / (found.slope @ found.slope))


def places(vehicle: Vehicle, drives: Sequence[Drive]) -> list[tuple[float, float]]:
    """Places on the map where several drives have peaks: of the road, rather than of the car."""
    peaks = []
    for drive in drives:
        for i in np.flatnonzero(np.abs(residual(vehicle, drive).yaw_rate) > _PEAK):
            peaks.append((drive.name, *drive.position[kept(drive)[i]].tolist()))
    found: list[tuple[float, float]] = []
    for name, x, y in peaks:
        others = {n for n, a, b in peaks if n != name and math.hypot(a - x, b - y) < _NEAR}
        if others and all(math.hypot(a - x, b - y) >= _NEAR for a, b in found):
            found.append((round(x, 1), round(y, 1)))
    return found


def away(drive: Drive, spots: Sequence[tuple[float, float]]) -> Any:
    """Of the compared ticks, those away from those places and later than 1 s after them."""
    near = np.zeros(len(drive.yaw), dtype=bool)
    for spot in spots:
        near |= np.hypot(*(drive.position - spot).T) < _NEAR
    for i in np.flatnonzero(near):
        near[i : i + round(1.0 / DT)] = True
    return ~near[kept(drive)]


def table(
    vehicle: Vehicle, drives: Sequence[Drive], spots: Sequence[tuple[float, float]], **how: Any
) -> dict[str, Any]:
    """Residuals by wished speed, pooled over logs, and for each log."""
    out = {}
    by = {drive.name: residual(vehicle, drive, **how) for drive in drives}
    free = {drive.name: residual(vehicle, drive, held=False, **how) for drive in drives}
    for speed, target in TARGETS.items():
        some = [drive for drive in drives if drive.speed == speed]
        if not some:
            continue
        parts = [by[drive.name] for drive in some]
        pooled = Residual(*(np.concatenate(values) for values in zip(*parts, strict=True)))
        clear = np.concatenate([away(drive, spots) for drive in some])
        out[f"{speed:g} m/s"] = {
            "yaw_rate_rms": rms(pooled.recorded),
            "yaw_rate_residual": rms(pooled.yaw_rate),
            "target": target,
            "yaw_rate_residual_away_from_places": rms(pooled.yaw_rate[clear]),
            "share_of_ticks_away": float(clear.mean()),
            "side_speed_residual": rms(pooled.side),
            "lag": sum(map(lag, parts)) / len(parts),
            "free_speed_residual": rms(np.concatenate([free[d.name].speed for d in some])),
            "free_yaw_rate_residual": rms(np.concatenate([free[d.name].yaw_rate for d in some])),
            "logs": {drive.name: rms(by[drive.name].yaw_rate) for drive in some},
        }
    return out


# --------------------------------------------------------------------------- along the road


def held_throttle(vehicle: Vehicle, speed: float) -> float:
    """Throttle that holds a speed on a straight."""
    state = np.zeros(car.N_STATE)
    steady_turn(vehicle.table, 0, state, speed, 0.0)
    return float(state[car.THROTTLE])


def times_to(vehicle: Vehicle, speeds: Sequence[float]) -> list[float]:
    """Times from standstill to those speeds at full throttle [s]."""
    steps = 600
    command, base = np.tile([0.0, 1.0, 0.0], (steps, 1)), np.zeros((steps + 1, car.N_STATE))
    out, work = np.zeros_like(base), np.zeros((3, car.N_MOTION))
    replay(vehicle.table, command, np.zeros(1, np.int64), base, False, H, out, work)
    return [float(np.interp(v, out[:, car.VX], H * np.arange(steps + 1))) for v in speeds]


_LAUNCHES = (1.0, 5.0, 10.0, 14.0)


def along(vehicle: Vehicle, drives: Sequence[Drive]) -> dict[str, Any]:
    """Throttles that hold the recorded speeds, and the launch, of logs and vehicle."""
    holding, launches = {}, {}
    for speed in TARGETS:
        held, at = [], []
        for drive in drives:
            calm = np.abs(np.gradient(drive.measured_speed, DT)) < 0.15  # noqa: PLR2004
            calm &= (np.abs(drive.velocity[:, 2]) < 0.03) & (drive.speed == speed)  # noqa: PLR2004
            calm[: 2 * _LAUNCH] = False
            held += drive.command[calm, 1].tolist()
            at += drive.measured_speed[calm].tolist()
        if held:
            v = float(np.median(at))
            log = float(np.median(held))
            mine = held_throttle(vehicle, v)
            holding[f"{v:.2f} m/s"] = {"log": log, "vehicle": mine, "difference": mine - log}
    mine = times_to(vehicle, _LAUNCHES)
    for speed, time in zip(_LAUNCHES, mine, strict=True):
        logs = []
        for drive in drives:
            full = np.flatnonzero(drive.command[:, 1] < 1.0)
            until = int(full[0]) if full.size else len(drive.yaw)
            reached = np.flatnonzero(drive.measured_speed[: until + 1] >= speed)
            if reached.size:
                i = int(reached[0])
                v = drive.measured_speed
                logs.append(DT * (i - (v[i] - speed) / (v[i] - v[i - 1])))
        if logs:
            launches[f"0 to {speed:g} m/s"] = {"log": [min(logs), max(logs)], "vehicle": time}
    return {"holding_throttle": holding, "full_throttle": launches}


# ------------------------------------------------------------------------------------- fit


def say(text: str) -> None:
    """Progress, beside the result."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


class Figure(NamedTuple):
    """A figure that is fitted, by its logarithm, and its bounds."""

    start: float
    low: float
    high: float


FIGURES = {
    "c_f": Figure(155_690.0, 3e4, 6e5),
    "c_r": Figure(99_040.0, 2e4, 4e5),
    "yaw_inertia": Figure(3000.0, 600.0, 9000.0),
    "friction": Figure(3.2, 1.0, 8.0),
    "roll_arm": Figure(0.1, 0.005, 0.6),
    "steer_rate_up": Figure(4.0, 0.8, 40.0),
    "origin": Figure(ORIGIN, 0.05, 1.2),
}
"""``origin`` is the distance of the centre of mass from the actor's origin, at the same axles; the
falling steering rate is twice the rising one."""


def vehicle_of(base: Vehicle, figures: Mapping[str, float]) -> Vehicle:
    """The vehicle with those figures."""
    plain = dict(figures)
    origin = plain.pop("origin", ORIGIN)
    plain["steer_rate_down"] = 2.0 * plain.get("steer_rate_up", base.steer_rate_up)
    vehicle = base.model_copy(update=plain | {"l_f": FRONT - origin, "l_r": REAR + origin})
    vehicle.__dict__.pop("_built", None)  # the table of the other figures
    return vehicle


def fit(
    base: Vehicle,
    drives: Sequence[Drive],
    start: Mapping[str, float],
    fixed: Mapping[str, float],
    lead: float = 0.0,
) -> tuple[dict[str, float], float]:
    """Figures of ``start`` that fit the logs best with the others ``fixed``, and the loss."""
    names = list(start)
    ticks = {v: sum(len(d.yaw) for d in drives if d.speed == v) for v in TARGETS}

    def misses(z: Any) -> Any:
        figures = dict(zip(names, np.exp(z).tolist(), strict=True)) | dict(fixed)
        guess = vehicle_of(base, figures)
        origin, out = figures.get("origin", ORIGIN), []
        for drive in drives:
            found = residual(guess, drive, origin=origin, lead=lead)
            weight = 1.0 / (TARGETS[drive.speed] * math.sqrt(ticks[drive.speed]))
            out += [weight * found.yaw_rate, _SIDE_WEIGHT * weight * found.side]
        return np.concatenate(out)

    bounds = [[math.log(getattr(FIGURES[n], end)) for n in names] for end in ("low", "high")]
    found = least_squares(
        misses, [math.log(start[n]) for n in names], bounds=bounds, loss="soft_l1", f_scale=_SOFT,
        diff_step=1e-4, xtol=1e-4, ftol=3e-5, max_nfev=25,
    )  # fmt: skip
    return dict(zip(names, np.exp(found.x).tolist(), strict=True)), float(found.cost)


def fitted(base: Vehicle, drives: Sequence[Drive], lead: float, *, whole: bool) -> dict[str, Any]:
    """The fit, and if ``whole`` its validation over logs, intervals and profiles."""
    start = {name: figure.start for name, figure in FIGURES.items()}
    best, loss = fit(base, drives, start, {}, lead)
    out: dict[str, Any] = {"figures": best, "loss": loss}
    public = {n: FIGURES[n].start for n in ("c_f", "c_r", "origin")}
    rest = {name: value for name, value in best.items() if name not in public}
    figures, cost = fit(base, drives, rest, public, lead)
    out["stiffness_and_axles_held"] = {"figures": public | figures, "loss": cost}
    if not whole:
        return out
    say(f"lead {lead:g} s: loss {loss:.4f} {best}")
    left, held = [], {}
    for drive in drives:
        others = [d for d in drives if d is not drive]
        figures, _ = fit(base, others, best, {}, lead)
        left.append(figures)
        judged = residual(
            vehicle_of(base, figures), drive, origin=figures["origin"], lead=lead
        ).yaw_rate
        mine = residual(vehicle_of(base, best), drive, origin=best["origin"], lead=lead).yaw_rate
        held[drive.name] = {"held_out": rms(judged), "fitted_on_all": rms(mine)}
        say(f"{drive.name}: {held[drive.name]}")
    out["validation"] = held
    n = len(drives)
    wide = float(student.ppf(0.975, n - 1))
    out["intervals"] = {}
    for name in best:
        values = np.log([figures[name] for figures in left])
        error = wide * math.sqrt((n - 1) / n * float(np.sum((values - values.mean()) ** 2)))
        ends = [best[name] * math.exp(sign * error) for sign in (-1.0, 1.0)]
        out["intervals"][name] = ends
    out["profiles"] = {name: _profile(base, drives, best, loss, name, lead) for name in best}
    return out


_FACTORS = (0.6, 0.8, 0.9, 1.11, 1.25, 1.67)


def _profile(
    base: Vehicle,
    drives: Sequence[Drive],
    best: Mapping[str, float],
    loss: float,
    name: str,
    lead: float,
) -> dict[str, Any]:
    """Loss over one figure with the others fitted, and where it passes the 95 % level.

    The level is that of the F distribution's limit with one stretch as one sample, since ticks
    of a stretch are not independent.
    """
    samples = sum((len(d.yaw) - _LAUNCH) // STRETCH for d in drives)
    level = loss * (1.0 + 3.84 / (samples - len(best)))
    points = [(best[name], loss)]
    for side in (_FACTORS[:3][::-1], _FACTORS[3:]):
        start = {n: v for n, v in best.items() if n != name}
        for factor in side:
            value = best[name] * factor
            if not FIGURES[name].low <= value <= FIGURES[name].high:
                break
            start, cost = fit(base, drives, start, {name: value}, lead)
            points.append((value, cost))
            if cost > 1.5 * loss:
                break
    points.sort()
    values, costs = (np.array(part) for part in zip(*points, strict=True))
    ends: list[float | None] = []
    k = int(np.argmin(costs))
    for inner, outer in ((range(k, 0, -1), -1), (range(k, len(values) - 1), 1)):
        crossing = [i for i in inner if costs[i] <= level < costs[i + outer]]
        if not crossing:
            ends.append(None)
            continue
        i = crossing[0]
        share = (level - costs[i]) / (costs[i + outer] - costs[i])
        ends.append(float(values[i] * (values[i + outer] / values[i]) ** share))
    say(f"{name}: {ends}")
    told = None not in ends
    return {"values": values.tolist(), "losses": costs.tolist(), "level": level, "interval": ends,
            "told": told}  # fmt: skip


# --------------------------------------------------------------------------------- circle

THROTTLES = (0.4, 0.6, 0.8, 1.0)
PHYSX = {
    "speed": {0.4: 8.59, 0.6: 19.5, 0.8: 29.3, 1.0: 35.7},
    "side_slip_deg": {0.6: -1.15, 0.8: -6.04, 1.0: -15.2},
    "wheel_angle_deg": {9.9: 3.46, 18.7: 3.47, 22.2: 3.50, 24.2: 3.53},
    "side_slip_at_speed_deg": {9.9: 1.28, 18.7: -0.9, 22.2: -2.2, 24.2: -3.1},
    "yaw_rise": 0.32,
}
"""A PhysX 5 car with CARLA's figures, R 50 m (measured outside this project)."""


def circle(vehicle: Vehicle) -> dict[str, Any]:
    """R 50 m for 60 s at constant throttle, steady turns, and the rise of the yaw rate."""
    drives = {}
    for throttle in THROTTLES:
        run = sm.RunConfig(
            controller="tuned/lqr",
            vehicle=vehicle,
            path={"kind": "circle", "radius": 50.0},
            speed={"kind": "constant_throttle", "throttle": throttle},
            duration=60.0,
        )
        episode = sm.attempt(run).of_controller()
        late = episode["time"] > episode["time"][-1] - 10.0
        slip = np.degrees(np.arctan2(episode["v_y"], episode["v_x"]))[late]
        drives[f"{throttle:g}"] = {
            "end": episode.end,
            "seconds": float(episode["time"][-1]),
            "speed": float(np.hypot(episode["v_x"], episode["v_y"])[late].mean()),
            "physx_speed": PHYSX["speed"][throttle],
            "side_slip_deg": float(slip.mean()),
            "physx_side_slip_deg": PHYSX["side_slip_deg"].get(throttle),
            "lateral_error_rms_mm": 1e3 * rms(episode["lateral_error"][late]),
        }
    turns = {}
    for speed, wheel in PHYSX["wheel_angle_deg"].items():
        state = np.zeros(car.N_STATE)
        exists = bool(steady_turn(vehicle.table, 0, state, speed, 0.02))
        turns[f"{speed:g}"] = {
            "exists": exists,
            "wheel_angle_deg": math.degrees(state[car.WHEEL]),
            "physx_wheel_angle_deg": wheel,
            "side_slip_deg": math.degrees(math.atan2(state[car.VY], state[car.VX])),
            "physx_side_slip_deg": PHYSX["side_slip_at_speed_deg"][speed],
        }
    rise = {"vehicle": yaw_rise(vehicle), "physx": PHYSX["yaw_rise"]}
    return {"drives": drives, "turns": turns, "yaw_rise_t90": rise}


def yaw_rise(vehicle: Vehicle, speed: float = 20.0, acceleration: float = 2.0) -> float:
    """Time until the yaw rate has 90 % of its end after a step of the steering [s]."""
    state, work = np.zeros(car.N_STATE), np.zeros((3, car.N_MOTION))
    steady_turn(vehicle.table, 0, state, speed, acceleration / speed**2)
    command = state[[car.STEER, car.THROTTLE, car.BRAKE]].copy()
    final = float(state[car.YAW_RATE])
    steady_turn(vehicle.table, 0, state, speed, 0.0)
    for k in range(300):
        before = float(state[car.YAW_RATE])
        car.advance(vehicle.table, 0, state, command, H, 1, work)
        if state[car.YAW_RATE] >= 0.9 * final:
            return H * (k + (0.9 * final - before) / (float(state[car.YAW_RATE]) - before))
    return math.inf


# ----------------------------------------------------------------------------------- main


def figures(
    cars: Mapping[str, Vehicle], drives: Sequence[Drive], fits: Mapping[str, Any]
) -> list[LinePlot]:
    """Yaw rates of the fastest log, and the profiles of each fit."""
    drive = max(drives, key=lambda d: (d.speed, len(d.yaw)))
    some = kept(drive)[: round(12.0 / DT)]
    by = {name: residual(vehicle, drive) for name, vehicle in cars.items()}
    log = next(iter(by.values())).recorded[: len(some)]
    lines = [PlotLine("log", (DT * some).tolist(), log.tolist())]
    lines += [
        PlotLine(name, (DT * some).tolist(), (log + found.yaw_rate[: len(some)]).tolist())
        for name, found in by.items()
    ]
    title = f"{drive.name}: yaw rate, replayed in stretches of 2 s"
    plots = [LinePlot("yaw_rate", title, "time [s]", "yaw rate [rad/s]", lines)]
    for fit_name, found in fits.items():
        profiles = [
            PlotLine(name, [v / found["figures"][name] for v in p["values"]],
                     [loss / found["loss"] for loss in p["losses"]])
            for name, p in found.get("profiles", {}).items()
        ]  # fmt: skip
        if not profiles:
            continue
        title = f"Loss over one figure, the others fitted ({fit_name})"
        file = "profiles_" + fit_name.replace(" ", "_").replace(".", "_")
        axes = "figure / fitted figure", "loss / least loss"
        plots.append(LinePlot(file, title, *axes, profiles, log_x=True))
    return plots


def main(argv: Sequence[str] | None = None) -> int:
    """Read the logs, compare, fit if wanted, write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--carla-logs", type=Path, required=True, help="folder of CSV logs")
    parser.add_argument(
        "--vehicle", action="append", help="vehicle to compare; the first is the reference"
    )
    parser.add_argument("--fit", action="store_true", help="fit, validate, profiles (minutes)")
    parser.add_argument(
        "--lead", type=float, action="append", help="leads of the yaw to fit [s]; the first in full"
    )
    parser.add_argument("--out", type=Path, help="folder for recognise.json")
    words = parser.parse_args(argv)
    read_out = [read(file) for file in sorted(words.carla_logs.glob("*.csv"))]
    drives = [drive for drive in read_out if drive is not None]
    if not drives:
        raise SystemExit(f"{words.carla_logs}: no CSV file there has the columns {_COLUMNS}")
    cars = {
        name: sm.RunConfig(vehicle=name).vehicle
        for name in words.vehicle or ["carla_model3", "carla_model3_v1"]
    }
    spots = places(next(iter(cars.values())), drives)
    result: dict[str, Any] = {
        **provenance(), "logs": [d.name for d in drives], "places": spots, "vehicles": {}
    }  # fmt: skip
    for name, vehicle in cars.items():
        result["vehicles"][name] = {
            "lateral": table(vehicle, drives, spots),
            "along": along(vehicle, drives),
            "circle_50": circle(vehicle),
        }
    if words.fit:
        base = next(iter(cars.values()))
        leads = words.lead or [0.0]
        result["fits"] = {
            f"lead {lead:g} s": fitted(base, drives, lead, whole=lead == leads[0]) for lead in leads
        }
    text = json.dumps(result, indent=1, default=float)
    if words.out:
        make_folder(words.out)
        write_text(words.out / "recognise.json", text + "\n")
        for plot in figures(cars, drives, result.get("fits", {})):
            write_text(words.out / f"{plot.file}.svg", plot.svg())
    sys.stdout.write(text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
