"""Tune how much grip a controller reckons with that finds the friction by driving.

    python benchmarks/tune_grip.py --trials 120 --out results/joint/tuning.json

Drives ``grip_speed`` around tuned/mpc_delay with the friction that it finds, on slippery roads and
icy patches of generators, seeds and frictions that the suite ``beyond_grip`` does not have. A
trial's score is what is to be least: the share of drives lost, half of what the mean pace lacks of
0.9, and a twentieth of what it lacks of 1. A pace is the time of one that knows the friction over
the controller's own. The first trial has the defaults. The best one and they then drive on
``check``, other seeds and other frictions again: which of few drives are lost is much of chance.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import optuna
from joint import STEERS, profile

from steersman.bench.beyond import WISHED
from steersman.bench.disturbance import Disturbance
from steersman.bench.grip import demanded_grip
from steersman.bench.suite import Course, Scenario, Suite
from steersman.config import resolve
from steersman.disturbances import FrictionPatch
from steersman.files import write_text
from steersman.paths.generated import HarmonicRoad
from steersman.paths.random_road import RandomRoad
from steersman.provenance import provenance
from steersman.rollout import attempt

ROADS = {"harmonic_road": HarmonicRoad, "random_road": RandomRoad}
DISTANCE = 400.0
BOUNDS = {
    "least": (0.18, 0.3),
    "reach": (1.7, 3.0),
    "growth": (0.6, 3.0),
    "used": (0.5, 0.75),
    "cautious": (0.3, 0.6),
    "slow_growth": (0.01, 0.06),
    "braking": (0.35, 0.6),
}
PACE, PACE_WEIGHT, FASTER_WEIGHT = 0.9, 0.5, 0.05


class Grips(NamedTuple):
    """Roads and what they are covered with."""

    seeds: range
    whole: Mapping[str, float]
    """Friction of a whole road, by a word for it."""
    patches: Mapping[str, tuple[float, float, float, float]]
    """Begin, length and distance of patches [m] on a dry road, and their friction."""


TUNED = (
    Grips(
        range(340, 352),
        {"ice": 0.25, "snow": 0.4, "damp": 0.6, "rain": 0.8},
        {"short": (20.0, 30.0, 75.0, 0.5), "long": (45.0, 50.0, 110.0, 0.4)},
    ),
    Grips(
        range(330, 338),
        {"ice": 0.28, "snow": 0.35, "damp": 0.5, "rain": 0.75},
        {"short": (35.0, 25.0, 60.0, 0.45), "long": (10.0, 60.0, 130.0, 0.55)},
    ),
)
CHECK = (
    Grips(
        range(360, 375),
        {"ice": 0.27, "snow": 0.33, "damp": 0.45, "rain": 0.65},
        {"short": (25.0, 35.0, 80.0, 0.42), "long": (30.0, 55.0, 120.0, 0.48)},
    ),
)


class Drive(NamedTuple):
    """A drive, and the time that one takes who knows the friction [s]."""

    name: str
    scenario: Scenario
    seconds: float


def drives(sets: Sequence[Grips]) -> list[Drive]:
    """All whose wish is beyond grip, in the order of the suites."""
    return [drive for grips in sets for drive in drives_of(grips)]


def drives_of(grips: Grips) -> list[Drive]:
    """Those of one set."""
    found = []
    for one in suite(grips).scenarios():
        if demanded_grip(one.run) > 1.0:
            word = one.disturbance
            friction = grips.whole[word] if word in grips.whole else grips.patches[word][-1]
            told = {"speed": profile(friction, 20.0), "nominal": None}
            run = one.run.model_copy(update={**told, "controller": resolve("controller", STEERS)})
            episode = attempt(run).of_controller()
            if episode.completed:
                seconds = len(episode) * episode.dt
                found.append(Drive(f"{one.path}/{word}", one, seconds))
    return found


def suite(grips: Grips) -> Suite:
    """Wishes of 20 m/s from standstill on, in bends for 1.3 times the grip."""
    courses = {
        f"{name}_{seed}": Course(
            path=road(seed=seed, distance=DISTANCE),
            speeds={"wished": WISHED},
        )
        for name, road in ROADS.items()
        for seed in grips.seeds
    }
    whole = {
        word: Disturbance(friction=friction, used_grip=1.3, used_along=None)
        for word, friction in grips.whole.items()
    }
    patches = {
        word: Disturbance(
            friction=1.0,
            used_grip=0.6,
            used_along=None,
            disturbances=(FrictionPatch(begin=b, length=n, every=e, left=mu, right=mu),),
        )
        for word, (b, n, e, mu) in grips.patches.items()
    }
    return Suite(courses=courses, disturbances={**whole, **patches})


def driven(settings: Mapping[str, float], on: list[Drive]) -> dict[str, Any]:
    """The drives lost, the mean pace of the others, and the score."""
    words = {"kind": "grip_speed", "inner": STEERS, "found": True, **settings}
    controller = resolve("controller", words)
    lost, paces = [], []
    for name, scenario, seconds in on:
        run = scenario.run
        sensor = run.sensor.model_copy(update={"count": 41})
        run = run.model_copy(update={"sensor": sensor, "controller": controller})
        episode = attempt(run).of_controller()
        if episode.completed:
            paces.append(seconds / (len(episode) * episode.dt))
        else:
            lost.append(name)
    pace = float(np.mean(paces)) if paces else 0.0
    score = len(lost) / len(on) + PACE_WEIGHT * max(PACE - pace, 0.0) + FASTER_WEIGHT * (1.0 - pace)
    found = {"drives": len(on), "lost": lost, "pace": round(pace, 4), "score": round(score, 5)}
    return {"settings": {k: round(v, 4) for k, v in settings.items()}, **found}


def tuned(trials: int, on: list[Drive]) -> list[dict[str, Any]]:
    """All trials, the best first; the first one has the defaults."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    defaults = resolve("controller", "grip_speed")
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=0, multivariate=True))
    study.enqueue_trial({name: getattr(defaults, name) for name in BOUNDS})
    rows = []
    for k in range(trials):
        trial = study.ask()
        row = driven({n: trial.suggest_float(n, *bounds) for n, bounds in BOUNDS.items()}, on)
        study.tell(trial, row["score"])
        rows.append(row)
        told = f"{k}: {len(row['lost'])} lost, pace {row['pace']}, score {row['score']}"
        sys.stderr.write(f"{told}, {row['settings']}\n")
    return sorted(rows, key=lambda row: row["score"])


def main() -> None:
    """Tune, check, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=120)
    parser.add_argument("--out", required=True)
    given = parser.parse_args()
    trials = tuned(given.trials, drives(TUNED)) if given.trials else []
    check = drives(CHECK)
    out = {
        "commit": provenance()["commit"],
        "bounds": BOUNDS,
        "check": {
            "defaults": driven({}, check),
            **({"best": driven(trials[0]["settings"], check)} if trials else {}),
        },
        "trials": trials,
    }
    write_text(Path(given.out), json.dumps(out, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
