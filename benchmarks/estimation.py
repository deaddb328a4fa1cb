"""What the estimator and the predictor are worth: biases, noise against its bound, delay, time.

    python benchmarks/estimation.py biases noise suite delay time --out results/estimation

Each part writes a file of its own.

biases: the circle of radius 50 m at 18.7 m/s for 60 s, the road exact, odometry biased;
every tuned controller and the policy, alone and behind the estimator. ``moved_mm`` is what the bias
adds, at its largest; the rest is the controller's own.

noise: random roads with shifted waypoints. The bound is the standard deviation of the lateral error
given all waypoints so far, were the car's motion known exactly and the road's third difference over
2 m normal with the root mean square that it has on these roads. A linear problem: the inverse of
the information, of a grid of the road across.

suite: the same bound for the benchmark's drives with waypoint noise, of each road's own third
difference and each drive's mean speed; root mean squares over the drives of a disturbance.

delay: random roads at changing speed with 0.2 s of steering delay, alone and behind the predictor.

time: a step of the estimator and of the predictor in one process with a decision of LQR.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import PrivateAttr

from steersman.bench.drive import fitted
from steersman.bench.entrants import entrant
from steersman.bench.suites import suite
from steersman.config import build
from steersman.contracts.scenes import CAR, DT, PosedRoad, scenes
from steersman.controllers.base import ControllerComponent
from steersman.controllers.estimated import Estimated
from steersman.episode import Episode
from steersman.estimators.kalman import Kalman, KalmanState
from steersman.estimators.single_track import SingleTrack
from steersman.files import make_folder, write_text
from steersman.paths.base import PathComponent
from steersman.paths.random_road import RandomRoad
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt
from steersman.tuned import names
from steersman.types import FloatArray, Observation

BIASES: dict[str, dict[str, float]] = {
    "none": {},
    "v_y +0.035 m/s": {"v_y": 0.035},
    "v_y +0.1 m/s": {"v_y": 0.1},
    "v_x 5 % high": {"v_x_scale": 0.05},
    "yaw rate +0.01 rad/s": {"yaw_rate": 0.01},
}
ROADS = tuple(range(2020, 2026))
NOISES = (0.1, 0.3)
# Scenarios of each disturbance in results/bench.
SAMPLE = 8
# A road whose curvature never changes is taken to change by this all the same [m].
_STRAIGHT = 1e-5
SPEED = 15.0
DELAY = 0.2
DELAYED = ("lqr", "stanley", "stanley_cm", "sliding_mode", "mpc", "mpc_pid", "mpc_pid_scheduled")
# The first seconds, in which the filter settles, do not count [s].
SETTLED = 3.0


class Watched(Kalman):
    """The estimator, whose lateral errors are kept by time."""

    _found: dict[float, float] = PrivateAttr(default_factory=dict)

    def estimate(
        self, state: KalmanState, observation: Observation
    ) -> tuple[Observation, KalmanState]:
        """The posterior's observation."""
        seen, after = super().estimate(state, observation)
        self._found[seen.time] = seen.lateral_error
        return seen, after

    def errors(self, episode: Episode) -> FloatArray:
        """Estimated less true lateral error [m], once settled."""
        found = np.array([self._found[t] for t in episode["time"].tolist()])
        return (found - episode["lateral_error"])[episode["time"] > SETTLED]


def drive(controller: ControllerComponent, fields: dict[str, Any]) -> Episode:
    """A drive, as far as it went."""
    config = build(RunConfig, fields).model_copy(update={"controller": controller})
    return attempt(config).of_controller()


def figures(episode: Episode) -> dict[str, Any]:
    """Lateral errors, and how the drive ended."""
    error = episode["lateral_error"]
    return {
        "rms_mm": _mm(rms(error)),
        "largest_mm": _mm(np.abs(error).max()),
        "last_mm": _mm(error[-1]),
        "end": episode.end,
    }


def moved(episode: Episode, drives: dict[str, Episode]) -> dict[str, float]:
    """How far the bias moves the car: the largest difference from the drive without one."""
    ends = (episode["lateral_error"], drives["none"]["lateral_error"])
    both = min(len(end) for end in ends)
    return {"moved_mm": _mm(np.abs(ends[0][:both] - ends[1][:both]).max())}


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.square(values).mean()))


def _mm(value: float) -> float:
    return round(1e3 * float(value), 2)


def biases() -> dict[str, Any]:
    """Every controller under every bias."""
    out: dict[str, Any] = {}
    for word in (*names(), "precision"):
        own = entrant(word).controller
        for name, controller in ((word, own), (f"estimated/{word}", Estimated(controller=own))):
            drives = {words: drive(controller, _biased(bias)) for words, bias in BIASES.items()}
            out[name] = {
                words: figures(each) | moved(each, drives) for words, each in drives.items()
            }
            sys.stdout.write(f"{name}: {[row['moved_mm'] for row in out[name].values()]}\n")
    return out


def _biased(bias: dict[str, float]) -> dict[str, Any]:
    wrong = [{"kind": "sensor_bias", **bias}] if bias else []
    return {
        "path": {"kind": "circle", "radius": 50.0},
        "speed": {"kind": "constant_speed", "speed": 18.7},
        "duration": 60.0,
        "disturbances": wrong,
    }


def third_difference(roads: Iterable[PathComponent], spacing: float = 2.0) -> float:
    """Root mean square of the third difference of the roads across, at points 2 m apart [m]."""
    found = []
    for road in roads:
        kappa = [road.at(s).curvature for s in np.arange(0.0, road.length, spacing)]
        found.append(np.diff(kappa) * spacing**2)
    return max(rms(np.concatenate(found)), _STRAIGHT)


def bound(half: float, third: float, v: float = SPEED, *, count: int = 15) -> float:
    """Standard deviation of the lateral error given the waypoints of the last 60 m [m].

    Args:
        half: waypoints are shifted uniformly by up to this [m].
        third: standard deviation of the road's third difference at points 2 m apart [m].
        v: speed [m/s].
        count: number of waypoints, 2 m apart.
    """
    h, back, spacing = v * DT, 60.0, 2.0
    size = int((back + count * spacing) / h) + 8
    differences = np.zeros((size - 3, size))
    for i in range(size - 3):
        differences[i, i : i + 4] = (-1.0, 3.0, -3.0, 1.0)
    # White noise of the third derivative: its differences grow with the fifth power of the step.
    information = differences.T @ differences / (third**2 * (h / spacing) ** 5)
    steps = int(back / h)
    for k in range(steps + 1):
        for i in range(count):
            t = k + i * spacing / h
            j, w = int(t), t - int(t)
            row = np.array([1.0 - w, w])
            information[j : j + 2, j : j + 2] += np.outer(row, row) / (half**2 / 3.0)
    return float(np.sqrt(np.linalg.inv(information + 1e-9 * np.eye(size))[steps, steps]))


def noise() -> dict[str, Any]:
    """What the estimator leaves of waypoint noise, what drives make of it, and the bound."""
    third = third_difference(RandomRoad(seed=seed, distance=600.0) for seed in ROADS)
    out: dict[str, Any] = {"third_difference_mm": _mm(third), "speed_m_s": SPEED}
    for half in NOISES:
        left, driven, alone = [], [], []
        for seed in ROADS:
            fields = {
                "path": {"kind": "random_road", "seed": seed, "distance": 600.0},
                "speed": {"kind": "constant_speed", "speed": SPEED},
                "sensor": {"error_range": half},
                "seed": seed,
            }
            watched = Watched()
            episode = drive(
                Estimated(estimator=watched, controller=entrant("tuned/mpc_delay").controller),
                fields,
            )
            left.append(watched.errors(episode))
            driven.append(episode["lateral_error"][episode["time"] > SETTLED])
            own = drive(entrant("tuned/mpc_delay").controller, fields)
            alone.append(own["lateral_error"][own["time"] > SETTLED])
        least = bound(half, third)
        found = [rms(np.concatenate(rows)) for rows in (left, driven, alone)]
        out[f"{half} m"] = {
            "bound_mm": _mm(least),
            "estimate_mm": _mm(found[0]),
            "estimate_over_bound": round(found[0] / least, 2),
            "estimate_over_bound_by_road": [round(rms(row) / least, 2) for row in left],
            "driven_mm": _mm(found[1]),
            "driven_over_bound": round(found[1] / least, 2),
            "mpc_delay_alone_mm": _mm(found[2]),
        }
        sys.stdout.write(f"{half}: {out[f'{half} m']}\n")
    return out


def suite_bounds() -> dict[str, Any]:
    """The bound in the benchmark's drives with waypoint noise."""
    found: dict[str, list[float]] = {}
    driver = entrant("estimated/tuned/mpc_delay")
    for one in suite("standard", [f"sample={SAMPLE}"]).scenarios():
        half = one.run.sensor.error_range
        if one.disturbance.startswith("noise_"):
            speeds = attempt(fitted(one, driver)).of_controller()["v_x"]
            least = bound(half, third_difference([one.run.path]), float(np.mean(speeds)))
            found.setdefault(one.disturbance, []).append(least)
    return {name: {"bound_mm": _mm(rms(np.array(v))), "of": len(v)} for name, v in found.items()}


def delay() -> dict[str, Any]:
    """Every controller without a model of delay, alone and behind the predictor."""
    out: dict[str, Any] = {}
    for name in DELAYED:
        own = entrant(f"tuned/{name}").controller
        given = SingleTrack(delay=DELAY)
        rows = {
            "alone": own,
            "delay found": Estimated(estimator=None, predictor=SingleTrack(), controller=own),
            "delay given": Estimated(estimator=None, predictor=given, controller=own),
            "behind both": Estimated(predictor=SingleTrack(), controller=own),
        }
        out[name] = {words: _delayed(controller) for words, controller in rows.items()}
        sys.stdout.write(f"{name}: {out[name]}\n")
    return out


def _delayed(controller: ControllerComponent) -> dict[str, Any]:
    episodes = [
        drive(
            controller,
            {
                "path": {"kind": "random_road", "seed": seed, "distance": 600.0},
                "speed": {"kind": "random_profile", "high": 25.0, "a_lat_max": 6.0, "seed": seed},
                "plant": {"steering_delay": DELAY},
            },
        )
        for seed in ROADS
    ]
    return {
        "lost": sum(not episode.completed for episode in episodes),
        "of": len(episodes),
        "rms_mm": _mm(rms(np.concatenate([episode["lateral_error"] for episode in episodes]))),
    }


def times() -> dict[str, Any]:
    """Median times of a step [us], the three in turn in one process."""
    row = scenes(PosedRoad())
    lqr = entrant("tuned/lqr").controller
    steps: dict[str, Callable[[Any, Observation], tuple[Any, Any]]] = {
        "estimator": Kalman().estimate,
        "predictor, 0.2 s": SingleTrack(delay=DELAY).estimate,
        "lqr": lqr.step,
    }
    states = {
        "estimator": Kalman().init(CAR, DT),
        "predictor, 0.2 s": SingleTrack(delay=DELAY).init(CAR, DT),
        "lqr": lqr.init(CAR, DT),
    }
    took: dict[str, list[float]] = {name: [] for name in steps}
    for k in range(200 * len(row)):
        observation = row[k % len(row)]._replace(time=k * DT)
        for name, step in steps.items():
            begun = time.perf_counter()
            _, states[name] = step(states[name], observation)
            took[name].append(time.perf_counter() - begun)
    out = {name: round(1e6 * float(np.median(found)), 1) for name, found in took.items()}
    return {"median_us": out, "over_lqr": {n: round(t / out["lqr"], 2) for n, t in out.items()}}


PARTS: dict[str, Callable[[], dict[str, Any]]] = {
    "biases": biases,
    "noise": noise,
    "suite": suite_bounds,
    "delay": delay,
    "time": times,
}


def main() -> None:
    """Measure the parts that are named and write their files."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("parts", nargs="*", choices=[*PARTS], default=[*PARTS])
    parser.add_argument("--out", default="results/estimation")
    given = parser.parse_args()
    make_folder(Path(given.out))
    for name in given.parts:
        record = {"found": PARTS[name](), **provenance()}
        file = Path(given.out) / f"{name}.json"
        write_text(file, json.dumps(record, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
