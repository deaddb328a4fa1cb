"""One scenario driven by one controller: the row of its figures.

A drive that ends early is charged the corridor's half width for everything that it did not drive.
Otherwise a controller that leaves the road early would be judged by the little that it drove.
"""

from __future__ import annotations

import hashlib
import json
import math
import time

import numpy as np

from steersman.bench.disturbance import Disturbance
from steersman.bench.entrants import Entrant
from steersman.bench.grip import demanded_grip
from steersman.bench.results import BenchRow
from steersman.bench.suite import Scenario
from steersman.config import dump
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.metrics.base import evaluate, metrics
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt
from steersman.types import FloatArray

# Columns of a row that say in words what its numbers say already: rows without them stay valid.
_WORDS = ("error",)
# For estimates only [m/s].
_USUAL_SPEED = 12.0
FACTORS = ("path", "speed", "disturbance", "vehicle", "seed")


def fitted(scenario: Scenario, entrant: Entrant) -> RunConfig:
    """The scenario's run with this controller.

    A policy that reads more waypoints than the suite's sensor gives, or others, gets its own.
    """
    config, sensor = scenario.run, scenario.run.sensor
    plant = config.plant.recorded()
    if entrant.waypoints > sensor.count or entrant.spacing not in (0.0, sensor.spacing):
        count = max(entrant.waypoints, 4)
        sensor = sensor.model_copy(update={"count": count, "spacing": entrant.spacing})
    parts = {"controller": entrant.controller, "sensor": sensor, "plant": plant}
    return config.model_copy(update=parts)


def key(plan: str, config: RunConfig, entrant: Entrant) -> str:
    """What a row is kept under: the same for the same controller in the same run.

    Args:
        plan: digest of the scenario, of :func:`digest`.
        config: the run as it is driven, of :func:`fitted`.
        entrant: the controller.
    """
    sensor = f"{config.sensor.count} {config.sensor.spacing!r}"
    return _hashed(f"{row_version()} {plan} {entrant.digest} {sensor}")


def digest(scenario: Scenario) -> str:
    """Changes with the name and with everything in the run of a scenario but its controller."""
    plan = dump(scenario.run) or {}
    del plan["controller"]
    if plan["speed"].get("acceleration", 0.0) is None:
        del plan["speed"]["acceleration"]
    for name in ("lead", "fault", "disturbances", "estimator", "predictor"):
        if not plan[name]:
            del plan[name]
    return _hashed(json.dumps([scenario.name, plan], sort_keys=True))


def _hashed(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def drive(scenario: Scenario, entrant: Entrant) -> Episode:
    """The episode; what was driven until then, if the controller failed.

    Raises:
        PlantError: the plant failed.
    """
    return attempt(fitted(scenario, entrant)).of_controller()


def measure(scenario: Scenario, entrant: Entrant, key: str = "") -> BenchRow:
    """Everything that is kept of a drive; numbers are finite or None."""
    begun = time.process_time()
    tried = attempt(fitted(scenario, entrant))
    episode = tried.of_controller()
    config, errors = scenario.run, episode["lateral_error"]
    share, corridor = driven_share(config, episode), config.corridor
    largest = corridor if share < 1.0 else charged_quantile(errors, 1.0, corridor, 1.0)
    row = BenchRow(
        key=key,
        controller=entrant.name,
        replicate=entrant.replicate,
        kind=entrant.controller.kind,
        learned=entrant.learned,
        scenario=scenario.name,
        **{name: getattr(scenario, name) for name in FACTORS},
        applied=scenario.applied.figures(),
        grip_share=demanded_grip(config) if scenario.graded else None,
        dt_s=episode.dt,
        end=episode.end,
        driven_share=share,
        charged_rms_m=charged_rms(errors, share, corridor),
        charged_mean_m=charged_mean(errors, share, corridor),
        charged_p95_m=charged_quantile(errors, share, corridor, 0.95),
        charged_max_m=largest,
        metrics=evaluate(episode, metrics(benchmark=True)),
        plant=None if config.plant.embedded else episode.meta["plant"],
        error=None if tried.error is None else str(tried.error),
        commit=provenance()["commit"],
        computing_time_s=0.0,
    )
    return row.model_copy(update={"computing_time_s": time.process_time() - begun})


def driven_share(run: RunConfig, episode: Episode) -> float:
    """Share in [0, 1] of the planned time or distance that was driven; 1 if it was completed."""
    if episode.completed:
        return 1.0
    if run.duration is not None or (run.laps is None and run.path.closed):
        share = len(episode) * episode.dt / (60.0 if run.duration is None else run.duration)
    else:
        share = episode.distance / ((run.laps or 1.0) * run.path.length - _start(run))
    # A drive that failed has always something left that it is charged for.
    return min(max(share, 0.0), 1.0 - 1e-9)


def _start(run: RunConfig) -> float:
    return 0.0 if run.path.closed else run.start.s


def charged_rms(errors: FloatArray, share: float, corridor: float) -> float:
    """Root mean square of |d| over the plan [m]: driven for ``share``, else ``corridor``.

    >>> charged_rms(np.array([0.3, 0.4]), 1.0, 1.5) == math.sqrt(0.125)
    True
    >>> charged_rms(np.zeros(9), 0.75, 1.0)
    0.5
    """
    driven = float(np.mean(np.square(_bounded(errors, corridor)))) if errors.size else 0.0
    share = share if errors.size else 0.0
    return math.sqrt(share * driven + (1.0 - share) * corridor * corridor)


def charged_mean(errors: FloatArray, share: float, corridor: float) -> float:
    """Mean of |d| over the plan [m], charged in the same way."""
    driven = float(np.mean(_bounded(errors, corridor))) if errors.size else 0.0
    share = share if errors.size else 0.0
    return share * driven + (1.0 - share) * corridor


def charged_quantile(errors: FloatArray, share: float, corridor: float, q: float) -> float:
    """Quantile ``q`` in [0, 1] of |d| over the plan [m], charged in the same way."""
    if not errors.size or q > share:
        return corridor
    return float(np.quantile(_bounded(errors, corridor), min(q / share, 1.0)))


def _bounded(errors: FloatArray, corridor: float) -> FloatArray:
    """|d|, at most the corridor's half width; what is not finite counts as that."""
    size = np.abs(np.nan_to_num(errors, nan=corridor, posinf=corridor, neginf=corridor))
    return np.minimum(size, corridor)


def check(scenario: Scenario, entrant: Entrant) -> None:
    """Drive 0.2 s of the scenario, so that what does not fit is refused before anything runs.

    It also compiles the kernels, or loads them, once before many processes do.

    Raises:
        ConfigError: the controller does not fit the suite's loop.
        DataError: a file that it reads is missing or corrupt.
    """
    short = fitted(scenario, entrant).model_copy(update={"duration": 0.2, "laps": None})
    try:
        attempt(short).of_controller()  # a controller that fails at once is a result
    except ConfigError as error:
        raise ConfigError(f"{entrant.name}: {error}") from None


def planned_seconds(config: RunConfig) -> float:
    """About how long a run lasts in the simulation [s]."""
    if config.duration is not None:
        return config.duration
    return max((config.laps or 1.0) * config.path.length / _USUAL_SPEED, 1.0)


def row_version() -> str:
    """Digest of the names, types and units of a row's columns, those of plug-ins included.

    A row of another version does not have the same columns: its scenario is driven again.
    """
    fields = {
        name: str(field.annotation)
        for name, field in BenchRow.model_fields.items()
        if name not in _WORDS
    }
    measured = {name: [m.unit, m.dtype.__name__] for name, m in metrics(benchmark=True).items()}
    columns = [fields, list(Disturbance().figures()), measured]
    return hashlib.sha256(json.dumps(columns).encode()).hexdigest()[:12]
