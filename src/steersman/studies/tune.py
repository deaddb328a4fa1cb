"""Tune a controller's gains on a suite of runs with Optuna; every controller, the same budget.

The objective of a run is its RMS lateral error [m] plus a price on the RMS steering rate; a run
that leaves the road is charged the corridor's half width for the part it did not drive. The
objective of a trial is the mean over the suite.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Annotated, Any

import yaml
from pydantic import field_validator

from steersman.bench.metrics import summarise
from steersman.bench.suites import suite
from steersman.config import Of, Settings, build, dump, override, param, read_yaml, to_yaml
from steersman.controllers.base import ControllerComponent
from steersman.errors import ConfigError
from steersman.files import make_folder, write_text
from steersman.provenance import provenance
from steersman.rollout import RunConfig, run


class TuneConfig(Settings):
    """A tuning study."""

    controller: Annotated[ControllerComponent, Of("controller")] = param(
        "mpc_pid", "-", "Controller to tune; its other fields stay as given here."
    )
    suite: tuple[RunConfig, ...] = param(
        (
            {
                "path": {"kind": "training_circuit"},
                "speed": {"kind": "constant_speed", "speed": 30.0 / 3.6},
                "laps": 1,
            },
        ),
        "-",
        "Runs to tune on, or the name of a suite; their controller is replaced.",
    )
    trials: int = param(200, "-", "Trials in all, those of earlier sessions included.", ge=1)
    smoothness: float = param(
        0.05, "m s", "Price of the RMS steering rate, in lateral error per 1/s.", ge=0
    )
    seed: int = param(0, "-", "Seed of the sampler.", ge=0)

    @field_validator("suite", mode="before")
    @classmethod
    def _named(cls, value: Any) -> Any:
        return [s.run for s in suite(value).scenarios()] if isinstance(value, str) else value

    @field_validator("suite")
    @classmethod
    def _some(cls, value: tuple[RunConfig, ...]) -> tuple[RunConfig, ...]:
        if not value:
            raise ValueError("needs at least one run")
        return value


def cost(config: RunConfig, smoothness: float) -> float:
    """Objective of one run [m]; finite whatever the controller does."""
    episode = run(config)
    metrics = summarise(episode)
    rms, rate = float(metrics["rms_lateral_error_m"]), float(metrics["steer_rate_rms_per_s"])
    value = rms + smoothness * rate
    if episode.completed:
        return value
    goal = (config.laps or 1.0) * config.path.length
    if config.duration is not None:
        driven = float(metrics["duration_s"]) / config.duration
    else:
        driven = episode.distance / goal
    left = min(max(1.0 - driven, 0.05), 1.0)
    return value * (1.0 - left) + config.corridor * (1.0 + left)


def tune(
    config: TuneConfig, out: FilePath, progress: Callable[[int, float], None] | None = None
) -> ControllerComponent:
    """Search the controller's declared ranges; returns the best configuration found.

    Writes ``study.jsonl`` (Optuna's journal, from which an interrupted study goes on),
    ``tuned.yaml`` (the controller, as ``steersman drive`` reads it), ``config.yaml`` and
    ``result.json``. The first trial is the controller as it is, so the result is never worse on
    the suite.

    Raises:
        ConfigError: the controller declares nothing to tune, or ``out`` holds another study.
    """
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    if not config.controller.search:
        raise ConfigError(f"controller {config.controller.kind} declares nothing to tune")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    make_folder(out)
    _same_study(config, out)
    study = optuna.create_study(
        study_name=config.controller.kind,
        storage=JournalStorage(JournalFileBackend(str(out / "study.jsonl"))),
        sampler=optuna.samplers.TPESampler(seed=config.seed, multivariate=True),
        load_if_exists=True,
    )
    done = len([t for t in study.trials if t.state.is_finished()])
    if done == 0:
        study.enqueue_trial(_present(config.controller))
    for number in range(done, config.trials):
        trial = study.ask()
        controller = _suggest(config.controller, trial)
        costs = [
            cost(r.model_copy(update={"controller": controller}), config.smoothness)
            for r in config.suite
        ]
        study.tell(trial, sum(costs) / len(costs))
        if progress is not None:
            progress(number + 1, study.best_value)
    best = _apply(config.controller, study.best_params)
    _write(config, out, best, study)
    return best


def _same_study(config: TuneConfig, out: FilePath) -> None:
    """Keep the study's configuration in ``out``, or compare it; only ``trials`` may differ.

    Raises:
        ConfigError: the folder holds a study of something else.
    """
    file = out / "config.yaml"
    if file.exists():
        # Read as a configuration, so that fields that are new since then have their defaults.
        before = dump(build(TuneConfig, read_yaml(file) | {"trials": config.trials})) or {}
        now = dump(config) or {}
        for key in now:
            if before.get(key) != now[key]:
                raise ConfigError(f"{out} holds a study with another {key}; give another folder")
    write_text(file, to_yaml(config))


def _suggest(controller: ControllerComponent, trial: Any) -> ControllerComponent:
    values = {
        name: trial.suggest_float(name, low, high, log=log)
        for name, (low, high, log) in controller.search.items()
    }
    return _apply(controller, values)


def _apply(controller: ControllerComponent, values: dict[str, float]) -> ControllerComponent:
    data = override(dump(controller) or {}, [f"{name}={value!r}" for name, value in values.items()])
    del data["kind"]
    return build(type(controller), data)


def _present(controller: ControllerComponent) -> dict[str, float]:
    """The controller's own values, brought into the ranges."""
    out = {}
    for name, (low, high, _) in controller.search.items():
        value: Any = controller
        for part in name.split("."):
            value = getattr(value, part)
        out[name] = min(max(float(value), low), high)
    return out


def _write(config: TuneConfig, out: FilePath, best: ControllerComponent, study: Any) -> None:
    # As a run's configuration, so that ``steersman drive tuned.yaml`` drives it.
    text = yaml.safe_dump({"controller": dump(best)}, sort_keys=False)
    write_text(out / "tuned.yaml", text)
    result = {
        "controller": dump(best),
        "start": dump(config.controller),
        "cost_m": study.best_value,
        "cost_of_first_trial_m": study.trials[0].value,
        "trials": len(study.trials),
        "suite": [dump(r) for r in config.suite],
        "smoothness": config.smoothness,
        "seed": config.seed,
        **provenance(),
    }
    write_text(out / "result.json", json.dumps(result, indent=1) + "\n")
