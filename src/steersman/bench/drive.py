"""One scenario driven by one entrant: a row of plain data."""

from __future__ import annotations

import hashlib
import json
import time
from typing import Any, TypeAlias

from steersman.bench.charge import charged_mean, charged_quantile, charged_rms, driven_share
from steersman.bench.entrants import Entrant
from steersman.bench.suite import Scenario
from steersman.config import dump
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.metrics.base import evaluate, metrics
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt

Row: TypeAlias = dict[str, Any]
# For estimates only [m/s].
_USUAL_SPEED = 12.0
# Of a row's columns: with others, what was driven before is driven again.
VERSION = 5
FACTORS = ("path", "speed", "disturbance", "vehicle", "seed")


def fitted(scenario: Scenario, entrant: Entrant) -> RunConfig:
    """The scenario's run with this controller.

    A policy that reads more waypoints than the suite's sensor gives, or others, gets its own. A
    fault happens around the controller.
    """
    config, sensor = scenario.run, scenario.run.sensor
    plant = config.plant.recorded()
    if entrant.waypoints > sensor.count or entrant.spacing not in (0.0, sensor.spacing):
        count = max(entrant.waypoints, 4)
        sensor = sensor.model_copy(update={"count": count, "spacing": entrant.spacing})
    controller, fault = entrant.controller, scenario.applied.fault
    if fault is not None:
        controller = fault.around(controller, config.seed)
    parts = {"controller": controller, "sensor": sensor, "plant": plant}
    return config.model_copy(update=parts)


def key(plan: str, config: RunConfig, entrant: Entrant) -> str:
    """What a row is kept under: the same for the same controller in the same run.

    Args:
        plan: digest of the scenario, of :func:`digest`.
        config: the run as it is driven, of :func:`fitted`.
        entrant: who drives.
    """
    sensor = f"{config.sensor.count} {config.sensor.spacing!r}"
    return _hashed(f"{VERSION} {plan} {entrant.digest} {sensor}")


def digest(scenario: Scenario) -> str:
    """Changes with the name and with everything in the run of a scenario but its controller."""
    plan = dump(scenario.run) or {}
    del plan["controller"]
    if scenario.applied.fault is not None:
        plan["fault"] = dump(scenario.applied.fault)
    return _hashed(json.dumps([scenario.name, plan], sort_keys=True))


def _hashed(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def drive(scenario: Scenario, entrant: Entrant) -> Episode:
    """The episode; what was driven until then, if the controller failed.

    Raises:
        PlantError: the plant failed.
    """
    return attempt(fitted(scenario, entrant)).of_controller()


def measure(scenario: Scenario, entrant: Entrant) -> Row:
    """Everything that is kept of a drive; numbers are finite or None."""
    begun = time.process_time()
    episode = drive(scenario, entrant)
    row = {
        "controller": entrant.name,
        "kind": entrant.controller.kind,
        "learned": entrant.learned,
        "scenario": scenario.name,
        **{name: getattr(scenario, name) for name in FACTORS},
        **{f"disturbance_{name}": v for name, v in scenario.applied.figures().items()},
        "dt_s": episode.dt,
        "end": episode.end,
        **charged(scenario.run, episode),
        **evaluate(episode, metrics(benchmark=True)),
        **({} if scenario.run.plant.embedded else {"plant": episode.meta["plant"]}),
        "commit": provenance()["commit"],
    }
    return {**row, "computing_time_s": time.process_time() - begun}


def charged(config: RunConfig, episode: Episode) -> dict[str, float]:
    """The share that was driven and the errors over the whole plan [m]."""
    share, errors = driven_share(config, episode), episode["lateral_error"]
    corridor = config.corridor
    return {
        "driven_share": share,
        "charged_rms_m": charged_rms(errors, share, corridor),
        "charged_mean_m": charged_mean(errors, share, corridor),
        "charged_p95_m": charged_quantile(errors, share, corridor, 0.95),
        "charged_max_m": corridor if share < 1.0 else charged_quantile(errors, 1.0, corridor, 1.0),
    }


def check(scenario: Scenario, entrant: Entrant) -> None:
    """Drive a moment of the scenario, so that what does not fit is told before anything runs.

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


def planned_seconds(scenario: Scenario) -> float:
    """About how long a run lasts in the simulation [s], for the progress bar."""
    config = scenario.run
    if config.duration is not None:
        return config.duration
    return max((config.laps or 1.0) * config.path.length / _USUAL_SPEED, 1.0)
