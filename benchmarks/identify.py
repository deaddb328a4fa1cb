"""How well identification finds known cars: errors, widths and coverage of its 95 % intervals.

    python benchmarks/identify.py --out results/identify/coverage.json

Each car is driven once by hand (steps of steering and throttle) and once by a controller on a
random road; each drive is recorded many times with other sensor noise, and identified from a
starting vehicle that is wrong. `inside` is the share of intervals that hold the true figure.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from hand_driven import NOISE, RECORDED, noisy, recording

from steersman.config import build
from steersman.files import write_text
from steersman.provenance import provenance
from steersman.rollout import RunConfig, run
from steersman.studies.identify.identification import identify
from steersman.studies.identify.recording import Log, of_episode
from steersman.studies.identify.unknowns import SENSOR
from steersman.vehicles import Bmw320i, CarlaMkz2020, CarlaModel3, Vehicle

_WRONG = {"c_f": 1.2, "c_r": 0.85, "yaw_inertia": 1.2, "max_wheel_angle": 1.1}
_MODEL3 = CarlaModel3(steer_delay=0.12, steer_lag=0.08, steer_bias=0.01)
_CARS: dict[str, tuple[Vehicle, dict[str, Any]]] = {
    "carla_model3, delay 0.12 s, lag 0.08 s, bias 0.01 rad": (_MODEL3, {}),
    "carla_mkz2020, delay 0.07 s": (CarlaMkz2020(steer_delay=0.07), {}),
    "bmw_320i, steering 1.5 lock/s": (
        Bmw320i(steer_rate_up=1.5, steer_rate_down=1.5),
        {"acceleration": 2.0, "top": 15.0, "throttles": (0.4, 0.5, 0.6)},
    ),
}
_ROAD = {
    "path": {"kind": "random_road", "distance": 2000.0},
    "controller": "mpc_delay",
}
_SHOWN = frozenset(
    (
        *("steer_delay", "steer_lag", "steer_rate_up", "steer_rate_down", "max_wheel_angle"),
        *("steer_curve_factor", "steer_bias", "c_f", "c_r", "yaw_inertia", "brake_force"),
    )
)


def starting(car: Vehicle) -> Vehicle:
    """A starting vehicle that is wrong in every figure that is to be found."""
    wrong = {name: factor * getattr(car, name) for name, factor in _WRONG.items()}
    rows = [[0.8 * a - 0.1 for a in row] for row in car.map_acceleration]
    nothing = {"steer_delay": 0.0, "steer_lag": 0.0, "steer_bias": 0.0}
    return car.replace(**wrong, **nothing, map_acceleration=rows)


def true_value(car: Vehicle, name: str) -> float:
    """Of a figure by its name in tables; sensors sit at the centre of mass, without offsets."""
    field, _, rest = name.partition("[")
    if field in SENSOR:
        return 0.0
    found: Any = getattr(car, field)
    for index in rest.replace("]", "").split("[") if rest else ():
        found = found[int(index)]
    return float(found)


def one(car: Vehicle, clean: Log, seed: int) -> list[tuple[str, float, float, bool]]:
    """Of each told figure: its error, the half width of its interval, and whether that holds."""
    found = identify(noisy(clean, seed), starting(car), 0.0)
    out = []
    for f in found.figures:
        if f.low is not None and f.high is not None:
            true = true_value(car, f.name)
            out.append((f.name, f.value - true, 0.5 * (f.high - f.low), f.low <= true <= f.high))
    return out


def drives(car: Vehicle, how: dict[str, Any], seconds: float) -> dict[str, Log]:
    """A drive by hand and one on a road, without noise."""
    speed: dict[str, Any] = {"high": how["top"], "a_lat_max": how["acceleration"]} if how else {}
    speed = {"kind": "random_profile", "seconds": 300.0, "change": 3.0, "a_lat_max": 4.0} | speed
    episode = run(build(RunConfig, _ROAD | {"vehicle": car, "speed": speed}))
    road = of_episode(episode)
    road = road._replace(signals={name: road.signals[name] for name in RECORDED})
    return {"by hand": recording(car, seconds, noise=0.0, **how), "random road": road}


def summary(car: Vehicle, found: list[list[tuple[str, float, float, bool]]]) -> dict[str, Any]:
    """Per figure over all recordings, and coverage of all and of all knots of the map."""
    by: dict[str, list[tuple[float, float, bool]]] = {}
    for result in found:
        for name, error, half, inside in result:
            by.setdefault(name, []).append((error, half, inside))
    figures = {}
    for name, rows in by.items():
        if name.partition("[")[0] in _SHOWN:
            errors, halves, inside = (np.array(column) for column in zip(*rows, strict=True))
            figures[name] = {
                "true": true_value(car, name),
                "told": len(rows),
                "bias": float(np.mean(errors)),
                "rms_error": float(np.sqrt(np.mean(errors**2))),
                "half_width": float(np.median(halves)),
                "inside": float(np.mean(inside)),
            }
    knots = [row for name, rows in by.items() if name.startswith("map") for row in rows]
    everything = [row[2] for rows in by.values() for row in rows]
    return {
        "recordings": len(found),
        "figures": figures,
        "map_acceleration": {
            "knots_told": len(knots) / len(found),
            "rms_error": float(np.sqrt(np.mean([row[0] ** 2 for row in knots]))),
            "half_width": float(np.median([row[1] for row in knots])),
            "inside": float(np.mean([row[2] for row in knots])),
        },
        "inside_of_all": float(np.mean(everything)),
        "intervals": len(everything),
    }


def main() -> None:
    """Run all and write one JSON file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recordings", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--resume", action="store_true", help="keep what is done in --out")
    given = parser.parse_args()
    begun, results = time.perf_counter(), dict[str, Any]()
    if given.out.is_file() and given.resume:
        results = json.loads(given.out.read_text(encoding="utf-8"))["cars"]
    parts = given.out.with_suffix(".parts.json")  # recordings of drives that are not finished
    found = json.loads(parts.read_text(encoding="utf-8")) if parts.is_file() else {}
    with ProcessPoolExecutor(given.jobs) as pool:
        for title, (car, how) in _CARS.items():
            for drive, clean in drives(car, how, given.seconds).items():
                name = f"{title}; {drive}"
                if name in results:
                    continue
                rows = found.setdefault(name, [])
                seeds = range(len(rows), given.recordings)
                for row in pool.map(one, *zip(*((car, clean, s) for s in seeds), strict=True)):
                    rows.append(row)
                    write_text(parts, json.dumps(found))
                    said = f"{name}: {len(rows)} after {time.perf_counter() - begun:.0f} s"
                    sys.stderr.write(said + "\n")
                results[name] = summary(car, rows) | {"seconds": clean.time[-1]}
                record = {"noise": NOISE, "wrong_by": _WRONG, "cars": results}
                text = json.dumps(record | {"made_by": provenance()}, indent=2)
                write_text(given.out, text + "\n")
    parts.unlink(missing_ok=True)


if __name__ == "__main__":
    main()
