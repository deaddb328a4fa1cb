"""What identification makes of real logs: of a race car, and of a real CARLA server's Model 3.

    python benchmarks/real_logs.py --data ../shared/data --out results/identify/real_logs.json

`race_car` fits the first 60 % of the log and predicts the rest, and profiles the yaw inertia;
`whole` is the time that the usual fit of the whole log takes; `thirds` fits each third and says how
far apart their figures are; `carla` fits the seven logs and compares the vehicle with them as
benchmarks/recognise.py does; `lap` drives a lap of the race car's line at its recorded speed with
each controller. A stage that is in the file already is not done again; --only names some.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import recognise

import steersman as sm
from steersman.files import write_text
from steersman.provenance import provenance
from steersman.studies.identify import identification, lateral
from steersman.studies.identify.estimate import cost, search
from steersman.studies.identify.identification import Identified
from steersman.studies.identify.recording import Log, read_log
from steersman.studies.identify.result import plain
from steersman.vehicles import Vehicle

RACE_CAR = "real_car/av21_putnam_park.csv"
COLUMNS = (
    "time=time(s),wheel_angle=delta(rad),v_x=vx(m/s),v_y=vy(m/s),yaw_rate=omega(rad/s),"
    "yaw=phi(rad),x=x(m),y=y(m),throttle_percent=throttle_ped_cmd(%),"
    "brake=brake_ped_cmd(kPa)/3000"
)
START = Vehicle(
    mass=790.0, l_f=1.248, l_r=1.7328, yaw_inertia=1000.0, track_width=1.65, height=0.3,
    c_f=180e3, c_r=130e3, friction=1.6, drive_front=0.0, brake_front=0.55, brake_force=9000.0,
    max_wheel_angle=0.3, ackermann=False, steer_curve_speed=(0.0, 40.0),
    steer_curve_factor=(1.0, 1.0), map_throttle=(0.0, 0.1, 0.2, 0.3, 0.5),
    map_speed=(0.0, 10.0, 20.0, 35.0),
    map_acceleration=(
        (-0.5, -0.8, -1.0, -1.5), (1.0, 0.5, 0.0, -0.5), (2.0, 1.5, 1.0, 0.3),
        (3.0, 2.5, 2.0, 1.0), (4.0, 4.0, 3.5, 2.5),
    ),
)  # fmt: skip
"""Mass and axle distances are the published ones; stiffnesses and friction are those of slicks (40
times the static load per radian); the rest is a guess."""
# The lap begins on the course, not in the pit lane [s].
LAP = (215.0, 400.0)


def _told(found: Identified, begun: float) -> dict[str, Any]:
    seconds = time.process_time() - begun
    return plain(found) | {"cpu_seconds": seconds, "log": Path(found.log.name).name}


def race_car(data: Path) -> dict[str, Any]:
    """The first 60 %, judged on the rest."""
    begun = time.process_time()
    log = read_log(data / RACE_CAR, columns=COLUMNS)
    found = identification.identify(log, START, 0.4, _say, last=True)
    result = _told(found, begun)
    return result | {
        "v_y_on_straights": straights(found.log),
        "yaw_inertia_profile": profile(
            found, "yaw_inertia", (500.0, 700.0, 1000.0, 1400.0, 2000.0)
        ),
    }


def whole(data: Path) -> dict[str, Any]:
    """As `steersman identify` fits it by default, and the processor's time."""
    begun = time.process_time()
    log = read_log(data / RACE_CAR, columns=COLUMNS)
    return _told(identification.identify(log, START, notify=_say), begun)


def straights(log: Log) -> dict[str, float]:
    """What v_y does where the car drives straight on, pooled within bands of 3 m/s [m/s]."""
    v, v_y = log.signals["v_x"], log.signals["v_y"]
    rate = np.nan_to_num(log.signals["yaw_rate"], nan=1.0)
    calm = (np.abs(rate) < 0.03) & (np.abs(log.signals["steer_command"]) < 0.03) & (v > 5.0)  # noqa: PLR2004
    bands = [v_y[calm & (v // 3.0 == k)] for k in np.unique(v[calm] // 3.0)]
    squares = sum(float(np.sum((band - band.mean()) ** 2)) for band in bands)
    return {"spread": float(np.sqrt(squares / calm.sum())), "rows": int(calm.sum())}


def profile(found: Identified, name: str, values: Sequence[float]) -> list[dict[str, float]]:
    """Of a figure held at each value, the others fitted: loss and RMS residual of each channel."""
    log = found.log
    start = START.replace(**identification.DIRECT)
    unknowns = lateral.searched(start, log)
    misses = lateral.misses_of(start, log, found.stretches, unknowns, found.use)
    by = {figure.name: figure for figure in found.figures}
    z = np.array([u.z(by[u.name].value) for u in unknowns])
    free = np.array([u.name != name for u in unknowns])
    scales, out = misses.scales(z), []
    for value in values:
        z = np.where(free, z, [u.z(value) for u in unknowns])
        z, _ = search(misses, z, free)
        left = misses(z)
        sizes = np.sqrt(np.nanmean(left**2, axis=0)).tolist()
        rms = dict(zip(lateral.channels(log), sizes, strict=True))
        out.append({name: value, "loss": cost(left, scales)} | rms)
    return out


def thirds(data: Path) -> dict[str, Any]:
    """Each third, and the figures that two of them tell, in standard deviations apart."""
    log = read_log(data / RACE_CAR, columns=COLUMNS.partition(",throttle")[0])
    cuts = np.searchsorted(log.time, np.linspace(0.0, log.time[-1], 4))
    fits = []
    for a, b in pairwise(cuts.tolist()):
        signals = {name: values[a:b] for name, values in log.signals.items()}
        part = Log(log.name, log.time[a:b] - log.time[a], signals)
        fits.append(identification.identify(part, START, 0.0, _say))
    apart: dict[str, list[float]] = {}
    for one, other in combinations(fits, 2):
        for f, g in zip(one.figures, other.figures, strict=False):
            if f.name == g.name and None not in {f.low, f.high, g.low, g.high}:
                half = np.hypot(f.high - f.low, g.high - g.low) / 2.0
                apart.setdefault(f.name, []).append(abs(f.value - g.value) / half)
    agree = float(np.mean([x <= 1.0 for values in apart.values() for x in values]))
    return {
        "fits": [plain(fit) | {"log": Path(fit.log.name).name} for fit in fits],
        "apart_in_joint_95_percent_widths": apart,
        "pairs_that_agree": agree,
    }


def carla(data: Path) -> dict[str, Any]:
    """The seven logs in one fit, and the residuals of the vehicle that it gives."""
    begun = time.process_time()
    found_files = sorted((data / "carla_logs").glob("s*.csv"))
    found = sm.identify(found_files, "carla_model3", columns="carla", holdout=0.0, notify=_say)
    result = _told(found, begun)
    drives = [d for d in map(recognise.read, found_files) if d is not None]
    start = sm.RunConfig(vehicle="carla_model3").vehicle
    spots = recognise.places(start, drives)
    for name, vehicle in (("start", start), ("identified", found.vehicle)):
        result[name] = {
            "lateral": recognise.table(vehicle, drives, spots),
            "along": recognise.along(vehicle, drives),
        }
    return result | {"log": [file.name for file in found_files]}


def lap(data: Path) -> dict[str, Any]:
    """RMS and largest lateral error of each controller [m], and how the lap ended."""
    path = {
        "kind": "log", "file": str(data / RACE_CAR), "window": LAP, "spacing": 3.0,
        "smoothing": 0.15, "columns": "time=time(s),x=x(m),y=y(m),v_x=vx(m/s)",
    }  # fmt: skip
    out = {}
    for name in CONTROLLERS:
        config = sm.RunConfig(controller=name, path=path, speed="path", duration=200.0)
        episode = sm.attempt(config).of_controller()
        error = episode["lateral_error"]
        out[name] = {
            "end": episode.end,
            "seconds": float(episode["time"][-1]),
            "rms": float(np.sqrt(np.mean(error**2))),
            "largest": float(np.max(np.abs(error))),
            "speed": [float(episode["v_x"].min()), float(episode["v_x"].max())],
        }
        _say(f"{name}: {out[name]}")
    return {"length": config.path.length, "controllers": out}


TUNED = (
    "bearing_pid", "lqr", "mpc", "mpc_delay", "mpc_pid", "mpc_pid_scheduled", "pid",
    "pid_feedforward", "pure_pursuit", "pure_pursuit_cm", "sliding_mode", "stanley", "stanley_cm",
)  # fmt: skip
CONTROLLERS = (*(f"tuned/{name}" for name in TUNED), "nmpc", "precision")
STAGES: dict[str, Callable[[Path], dict[str, Any]]] = {
    stage.__name__: stage for stage in (race_car, whole, carla, thirds, lap)
}


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def main() -> None:
    """Do the stages that are not done, and keep each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", choices=list(STAGES), action="append")
    words = parser.parse_args()
    if not (words.data / RACE_CAR).is_file():
        raise SystemExit(f"{words.data / RACE_CAR}: is not there; nothing is done")
    done = json.loads(words.out.read_text(encoding="utf-8")) if words.out.is_file() else {}
    for name in words.only or STAGES:
        if name not in done:
            done[name] = STAGES[name](words.data) | {"made_by": provenance()}
            write_text(words.out, json.dumps(done, indent=1, default=float) + "\n")


if __name__ == "__main__":
    main()
