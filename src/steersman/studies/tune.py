"""Tune a controller's gains on a suite of runs with Optuna; every controller, the same budget.

What a trial costs, and of what parts, :mod:`steersman.studies.objective` defines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated, Any

import yaml
from pydantic import ValidationInfo, field_validator

from steersman import words
from steersman.bench.drive import planned_seconds
from steersman.bench.suites import suite
from steersman.bench.tuning import on_car, on_road
from steersman.config import Of, Settings, build, dump, override, param
from steersman.controllers.base import ControllerComponent
from steersman.controllers.estimated import in_front
from steersman.engine.jobs import Workers
from steersman.engine.work import Job
from steersman.errors import ConfigError
from steersman.estimators.base import EstimatorComponent, PredictorComponent
from steersman.files import alone, make_folder, write_text
from steersman.naming import called
from steersman.paths.base import PathComponent
from steersman.plants.base import PlantComponent
from steersman.plants.simulator import SimulatorConfig
from steersman.provenance import provenance
from steersman.rollout import RunConfig
from steersman.studies.folder import open_study, same_study, sampler, trial_states
from steersman.studies.objective import Prices, RunCost, measure, together
from steersman.studies.racing import affordable, bound, raced
from steersman.studies.ranges import TriedValues, ranges, starts, widened
from steersman.studies.trials import TrialFigures, TuneResult, trade
from steersman.vehicles import Vehicle

# Simulated time from which drives of a trial are handed out together [s].
_PIECE_SIZE = 75.0
# What each run of the first trial cost [m], in the journal.
_RUNS = "cost_of_run_m"


class TuneConfig(Settings):
    """A tuning study."""

    controller: Annotated[ControllerComponent, Of("controller")] = param(
        "mpc_pid", "-", "Controller to tune; its other fields stay as given here."
    )
    estimator: Annotated[EstimatorComponent | None, Of("estimator", optional=True)] = param(
        None, "-", "State estimator in front of it; null: none."
    )
    predictor: Annotated[PredictorComponent | None, Of("predictor", optional=True)] = param(
        None, "-", "Predictor in front of it, for delays; null: none."
    )
    plant: Annotated[PlantComponent, Of("plant")] = param(
        SimulatorConfig(),
        "-",
        "Plant of the runs; what of a suite it cannot do is left out.",
    )
    vehicle: Annotated[Vehicle | None, Of("vehicle", optional=True)] = param(
        None, "-", "Car of the runs; null: the suite's."
    )
    road: Annotated[PathComponent | None, Of("path", optional=True)] = param(
        None, "-", "Road of the runs; null: the suite's."
    )
    suite: tuple[RunConfig, ...] = param(
        "tuning", "-", "Runs to tune on, or the name of a suite; their controller is replaced."
    )
    trials: int = param(200, "-", "Trials in all, those of earlier sessions included.", ge=1)
    smoothness: float = param(
        0.05, "m s", "Price of the RMS steering rate, in lateral error per 1/s.", ge=0
    )
    gap: float = param(
        0.05, "-", "Price of the RMS error of the gap to a car ahead, in lateral error per m.", ge=0
    )
    jerk: float = param(
        0.01,
        "s^3",
        "Price of the RMS longitudinal jerk behind a car ahead, in lateral error per m/s^3.",
        ge=0,
    )
    seed: int = param(0, "-", "Seed of the sampler.", ge=0)

    @field_validator("suite", mode="before")
    @classmethod
    def _driven(cls, value: Any, info: ValidationInfo) -> Any:
        # What was refused is absent, which is an error of its own.
        parts = {name: info.data.get(name) for name in ("plant", "vehicle", "road")}
        plant, vehicle, road = parts.values()
        if isinstance(value, str):
            if not parts.keys() <= info.data.keys():
                return [RunConfig()]
            found = suite(value).model_copy(update={"plant": plant})
            found = found if vehicle is None else on_car(found, vehicle)
            found = found if road is None else on_road(found, road)
            return [s.run for s in found.scenarios()]
        if not isinstance(value, (list, tuple)):
            return value
        given = {"plant": plant, "vehicle": vehicle, "path": road}
        own = {name: part for name, part in given.items() if part is not None}
        return [{**own, **run} if isinstance(run, dict) else run for run in value]

    @field_validator("suite")
    @classmethod
    def _some(cls, value: tuple[RunConfig, ...]) -> tuple[RunConfig, ...]:
        if not value:
            raise ValueError("needs at least one run")
        return value

    @property
    def prices(self) -> Prices:
        """What costs beside the lateral error."""
        return Prices(self.smoothness, self.gap, self.jerk)


def cost(config: RunConfig, smoothness: float) -> float:
    """Cost of one run [m]; finite whatever the controller does."""
    return measure(config, Prices(smoothness)).total


def _inside(controller: ControllerComponent) -> str:
    """The end of a message about a controller around another one, which has the gains."""
    before, inner = words.around(called(controller))
    return f"; tune {inner}, then drive {before}/DIR, the folder of its tuning" if before else ""


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
    the suite; the second one are the defaults of its kind.

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
    import optuna

    if not config.controller.search:
        told = f"controller {config.controller.kind} declares nothing to tune"
        raise ConfigError(told + _inside(config.controller))
    make_folder(out)
    same_study(config, out, ("trials",))
    study = open_study(out / "study.jsonl", config.controller.kind)
    with Workers(engine, jobs if config.plant.computed else 1) as workers:
        for number in range(len(_finished(study)), config.trials):
            values, space = _next(config, _finished(study))
            cost_m, kept = _drive(
                config, _apply(config.controller, values), workers, _finished(study)
            )
            study.add_trial(
                optuna.trial.create_trial(
                    params=values, distributions=space, value=cost_m, user_attrs=kept
                )
            )
            if progress is not None:
                progress(number + 1, study.best_value)
    best = _apply(config.controller, study.best_params)
    return _write(config, out, best, study)


def _next(config: TuneConfig, finished: Sequence[Any]) -> tuple[dict[str, float], dict[str, Any]]:
    """The values of the next trial, and the ranges that they come from.

    The sampler is made anew and sees the trials as if all came from the present ranges, so that an
    interrupted study draws what it would have drawn.
    """
    import optuna

    space: dict[str, Any] = {
        name: optuna.distributions.FloatDistribution(low, high, log=log)
        for name, (low, high, log) in ranges(config.controller, _tried(finished)).items()
    }
    first = starts(config.controller)
    if len(finished) < len(first):
        return first[len(finished)], space
    known = optuna.create_study(sampler=sampler(config.seed, len(finished)))
    known.add_trials(
        optuna.trial.create_trial(params=one.params, distributions=space, value=one.value)
        for one in finished
    )
    return known.ask(space).params, space


def _tried(finished: Sequence[Any]) -> list[TriedValues]:
    return [TriedValues(one.value, one.params) for one in finished]


def _drive(
    config: TuneConfig, controller: ControllerComponent, workers: Workers, before: Sequence[Any]
) -> tuple[float, dict[str, Any]]:
    """The cost of a trial [m], and what is kept beside it: figures, and costs of the first's runs.

    Of a trial that is stopped the cost is a bound, and only the simulated time is kept.
    """
    driver = in_front(controller, config.estimator, config.predictor)
    work = partial(_measured, config.prices)

    def drive(numbers: Sequence[int]) -> list[RunCost]:
        runs = [config.suite[k].model_copy(update={"controller": driver}) for k in numbers]
        jobs = [Job(str(k), run, planned_seconds(run)) for k, run in enumerate(runs)]
        return [*workers.run(work, jobs, piece_size=_PIECE_SIZE).values()]

    numbers = range(len(config.suite))
    if not before:
        all_of = drive(numbers)
        found = together(all_of)
        return found.cost_m, {**found._asdict(), _RUNS: [one.total for one in all_of]}
    costs = before[0].user_attrs.get(_RUNS, [0.0] * len(numbers))
    order = sorted(numbers, key=lambda k: -costs[k])
    driven = raced(drive, order, affordable([one.value for one in before]))
    if len(driven) < len(order):
        seconds = sum(one.seconds for one in driven.values())
        return bound(driven, len(order)), {"simulated_seconds": seconds}
    found = together([driven[k] for k in numbers])
    return found.cost_m, found._asdict()


def _measured(prices: Prices, run: RunConfig, _: object) -> RunCost:
    return measure(run, prices)


def _finished(study: Any) -> list[Any]:
    found: list[Any] = study.get_trials(deepcopy=False, states=[trial_states().COMPLETE])
    return found


def _apply(controller: ControllerComponent, values: dict[str, float]) -> ControllerComponent:
    data = override(dump(controller) or {}, [f"{name}={value!r}" for name, value in values.items()])
    del data["kind"]
    return build(type(controller), data)


def _write(config: TuneConfig, out: FilePath, best: ControllerComponent, study: Any) -> TuneResult:
    # As a run's configuration, so that ``steersman drive tuned.yaml`` drives it.
    driver = in_front(best, config.estimator, config.predictor)
    text = yaml.safe_dump({"controller": dump(driver)}, sort_keys=False)
    write_text(out / "tuned.yaml", f"# Tuned on: {config.plant.source()}\n{text}")
    searched = ranges(config.controller, _tried(_finished(study)))
    traded = trade(config.controller.kind, _finished(study), searched)
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
        widened=widened(config.controller, searched),
        seed=config.seed,
        history=traded,
        **provenance(),
    )
    result.write(out / "result.json")
    return result
