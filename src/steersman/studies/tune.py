"""Tune a controller's gains on a suite of runs with Optuna; every controller, the same budget.

What a trial costs, and of what parts, :mod:`steersman.studies.objective` defines.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated, Any

import yaml
from pydantic import ValidationInfo, field_validator

from steersman.bench.drive import planned_seconds
from steersman.bench.suites import suite
from steersman.config import Of, Settings, build, dump, override, param
from steersman.controllers.base import ControllerComponent
from steersman.engine.jobs import Workers
from steersman.engine.work import Job
from steersman.errors import ConfigError
from steersman.files import alone, make_folder, write_text
from steersman.plants.base import PlantComponent
from steersman.plants.simulator import SimulatorConfig
from steersman.provenance import provenance
from steersman.rollout import RunConfig
from steersman.studies.folder import same_study
from steersman.studies.objective import RunCost, TrialCost, measure, together
from steersman.studies.optuna_study import (
    close_unfinished,
    open_study,
    sampler,
    trial_states,
)
from steersman.studies.trials import TrialFigures, TuneResult, trade

# Simulated time from which drives of a trial are handed out together [s].
_PIECE_SIZE = 300.0


class TuneConfig(Settings):
    """A tuning study."""

    controller: Annotated[ControllerComponent, Of("controller")] = param(
        "mpc_pid", "-", "Controller to tune; its other fields stay as given here."
    )
    plant: Annotated[PlantComponent, Of("plant")] = param(
        SimulatorConfig(),
        "-",
        "Plant of the runs; what of a suite it cannot do is left out.",
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
    def _driven(cls, value: Any, info: ValidationInfo) -> Any:
        plant = info.data.get("plant")  # absent if it was refused, which is an error of its own
        if isinstance(value, str):
            return [s.run for s in suite(value).model_copy(update={"plant": plant}).scenarios()]
        if not isinstance(value, (list, tuple)):
            return value
        return [{"plant": plant, **run} if isinstance(run, dict) else run for run in value]

    @field_validator("suite")
    @classmethod
    def _some(cls, value: tuple[RunConfig, ...]) -> tuple[RunConfig, ...]:
        if not value:
            raise ValueError("needs at least one run")
        return value


def cost(config: RunConfig, smoothness: float) -> float:
    """Cost of one run [m]; finite whatever the controller does."""
    return measure(config, smoothness).total


@alone("out")
def tune(
    config: TuneConfig,
    out: FilePath,
    progress: Callable[[int, float], None] | None = None,
    *,
    engine: str | None = None,
    jobs: int | None = None,
) -> TuneResult:
    """Search the controller's declared ranges; ``result.controller`` is the best one found.

    Writes ``study.jsonl`` (Optuna's journal, from which an interrupted study goes on and ends as
    if it had not been), ``tuned.yaml`` (the controller, as ``steersman drive`` reads it),
    ``config.yaml``, ``pareto.json`` (of :class:`steersman.studies.trials.TuningTrials`) and
    ``result.json``. The first trial is the controller as it is, so the result is never worse on
    the suite.

    Args:
        config: what to tune, on what.
        out: folder of the study.
        progress: called after each trial with the trials done and the least cost so far [m].
        engine: of :class:`steersman.engine.jobs.Workers`; it does the drives of a trial, and the
            result does not depend on it.
        jobs: drives at a time; None: one for each core.

    Raises:
        ConfigError: the controller declares nothing to tune, or ``out`` holds another study.
    """
    if not config.controller.search:
        raise ConfigError(f"controller {config.controller.kind} declares nothing to tune")
    make_folder(out)
    same_study(config, out, ("trials",))
    study = open_study(out / "study.jsonl", config.controller.kind)
    close_unfinished(study)
    done = len(_finished(study))
    if done == 0 and not study.get_trials(deepcopy=False, states=[trial_states().WAITING]):
        study.enqueue_trial(_present(config.controller))
    with Workers(engine, jobs if config.plant.computed else 1) as workers:
        for number in range(done, config.trials):
            # Anew for each trial, so that an interrupted study draws what it would have drawn.
            study.sampler = sampler(config.seed, number)
            trial = study.ask()
            found = _drive(config, _suggest(config.controller, trial), workers)
            for name, value in found._asdict().items():
                trial.set_user_attr(name, value)
            study.tell(trial, found.cost_m)
            if progress is not None:
                progress(number + 1, study.best_value)
    best = _apply(config.controller, study.best_params)
    return _write(config, out, best, study)


def _drive(config: TuneConfig, controller: ControllerComponent, workers: Workers) -> TrialCost:
    jobs = [
        Job(str(k), run.model_copy(update={"controller": controller}), planned_seconds(run))
        for k, run in enumerate(config.suite)
    ]
    work = partial(_measured, config.smoothness)
    return together([*workers.run(work, jobs, piece_size=_PIECE_SIZE).values()])


def _measured(smoothness: float, run: RunConfig, _: object) -> RunCost:
    return measure(run, smoothness)


def _finished(study: Any) -> list[Any]:
    found: list[Any] = study.get_trials(deepcopy=False, states=[trial_states().COMPLETE])
    return found


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


def _write(config: TuneConfig, out: FilePath, best: ControllerComponent, study: Any) -> TuneResult:
    # As a run's configuration, so that ``steersman drive tuned.yaml`` drives it.
    text = yaml.safe_dump({"controller": dump(best)}, sort_keys=False)
    write_text(out / "tuned.yaml", f"# Tuned on: {config.plant.source()}\n{text}")
    traded = trade(config.controller.kind, _finished(study))
    traded.write(out / "pareto.json")
    figures = {name: getattr(traded.chosen(), name) for name in TrialFigures.model_fields}
    result = TuneResult(
        controller=best,
        start=dump(config.controller) or {},
        cost_m=study.best_value,
        cost_of_first_trial_m=traded.trials[0].cost_m,
        trials=len(traded.trials),
        chosen=TrialFigures(**figures),
        simulated_seconds=traded.simulated_seconds,
        simulated_trials=traded.measured,
        plant=config.plant.source(),
        suite=[dump(r) or {} for r in config.suite],
        smoothness=config.smoothness,
        seed=config.seed,
        **provenance(),
    )
    result.write(out / "result.json")
    return result
