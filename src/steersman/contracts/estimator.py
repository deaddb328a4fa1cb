"""What every estimator has to fulfil, and most of it every predictor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import PrivateAttr

from steersman.config import Of, dump, param, resolve
from steersman.contracts import Contract
from steersman.contracts.scenes import CAR, DT, PosedRoad, commands, drive, plain, scenes
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.estimators.base import EstimatorComponent
from steersman.types import Decision, FloatArray, Observation
from steersman.vehicles import Vehicle

# Columns of a row: lateral error, ... as in an observation from there on.
_ODD = [0, 1, 3, 4, 5, 6]


class Listening(Wrapper):
    """A controller whose observations and commands are kept, by the observation's time."""

    family: ClassVar[str] = "controller"

    controller: Annotated[ControllerComponent, Of("controller")] = param("lqr", "-", "It steers.")
    _seen: dict[float, tuple[Observation, float]] = PrivateAttr(default_factory=dict)

    def init(self, vehicle: Vehicle, dt: float) -> Any:
        """The controller's own state."""
        return self.controller.init(vehicle, dt)

    def step(self, state: Any, observation: Observation) -> tuple[Decision, Any]:
        """The controller's own decision."""
        decision, state = self.controller.step(state, observation)
        self._seen[observation.time] = observation, decision.steer
        return decision, state

    def record(self) -> tuple[list[Observation], list[float]]:
        """Observations and commands in their order."""
        observations, steers = zip(*self._seen.values(), strict=True)
        return list(observations), list(steers)


def as_row(observation: Observation) -> FloatArray:
    """Every number but the time."""
    return np.concatenate((observation[1:8], observation.preview.ravel()))


def as_rows(observations: Sequence[Observation]) -> FloatArray:
    """A row for each."""
    return np.array([as_row(o) for o in observations])


def estimates(
    estimator: EstimatorComponent, observations: Sequence[Observation], steers: Sequence[float]
) -> FloatArray:
    """A row for each observation; ``steers`` are executed after each."""
    state, out = estimator.init(CAR, DT), []
    for observation, steer in zip(observations, steers, strict=True):
        seen, state = estimator.estimate(state, observation)
        state = estimator.executed(state, steer)
        out.append(as_row(seen))
    return np.array(out)


def exact_drive(
    controller: ControllerComponent | None = None, **options: Any
) -> tuple[list[Observation], list[float]]:
    """Observations and commands of 8 s through bends, measured exactly."""
    listening = Listening() if controller is None else Listening(controller=controller)
    drive(listening, PosedRoad(), duration=8.0, **options)
    return listening.record()


def differences(found: FloatArray, expected: FloatArray) -> Iterator[str]:
    """Where rows differ by more than a controller should notice."""
    gap = np.abs(found - expected)
    for name, value, most, unit in (
        ("lateral error", gap[:, 0].max(), 0.02, "m"),
        ("heading error", gap[:, 1].max(), 0.01, "rad"),
        ("v_x, v_y", gap[:, 2:4].max(), 0.1, "m/s"),
        ("yaw rate", gap[:, 4].max(), 0.05, "rad/s"),
        ("waypoints", gap[:, 7:21].max(), 0.2, "m"),
    ):
        if not value <= most:
            yield f"{name}: {value:.3g} {unit} beside the truth"


def a_loaded_one_estimates_alike(estimator: EstimatorComponent) -> Iterator[str]:
    """As plain data and back, and twice."""
    drive_of = scenes(PosedRoad()), commands()
    again: Any = resolve(estimator.family, dump(estimator)) if estimator.kind else estimator
    if not np.array_equal(estimates(again, *drive_of), estimates(estimator, *drive_of)):
        yield "made again from its plain data it estimates otherwise"


def left_and_right_are_alike(estimator: EstimatorComponent) -> Iterator[str]:
    """A mirrored row of observations gives mirrored estimates."""
    left = estimates(estimator, scenes(PosedRoad()), commands())
    mirrored = scenes(PosedRoad(side=-1.0), side=-1.0)
    right = estimates(estimator, mirrored, [-u for u in commands()])
    right[:, _ODD] *= -1.0
    right[:, 8::2] *= -1.0
    if not np.allclose(left, right, rtol=1e-6, atol=1e-7):
        yield f"left and right differ by {np.abs(left - right).max():.3g}"


def any_finite_input_gives_finite_numbers(estimator: EstimatorComponent) -> Iterator[str]:
    """However large, small or odd; and a glitch is forgotten within a second."""
    observations, steers = exact_drive()
    truth = as_rows(observations)
    for size in (1e3, 1e100, 1e300):
        for k, name in enumerate(Observation._fields[1:8]):
            wrong = Observation(**{**observations[60]._asdict(), name: size})
            row = [*observations[:60], wrong, *observations[61:90]]
            found = estimates(estimator, row, steers[:90])
            if not np.isfinite(np.delete(found[60], k)).all():
                yield f"{name} = {size:g}: the estimate is not finite"
            yield from (f"{name} = {size:g}: {text}" for text in _later(found, truth))


def _later(found: FloatArray, truth: FloatArray) -> Iterator[str]:
    return differences(found[80:], truth[80 : len(found)])


def a_standing_car_stays(estimator: EstimatorComponent) -> Iterator[str]:
    """What is estimated of a car that stands still is that it stands still."""
    still = plain()._replace(v_x=0.0, v_y=0.0, yaw_rate=0.0)
    row = [still._replace(time=k * DT) for k in range(200)]
    found = estimates(estimator, row, [still.steer] * 200)
    yield from differences(found, as_rows(row))


def states_and_observations_are_left_alone(estimator: EstimatorComponent) -> Iterator[str]:
    """The same state and observation give one answer, whatever happened in between."""
    state, before = estimator.init(CAR, DT), as_rows(scenes(PosedRoad()))
    row = scenes(PosedRoad())
    for observation, steer in zip(row, commands(), strict=True):
        seen, after = estimator.estimate(state, observation)
        estimator.executed(after, steer)
        again, _ = estimator.estimate(state, observation)
        if not np.array_equal(as_row(seen), as_row(again)):
            yield "the same state and observation give two estimates"
            return
        state = after
    if not np.array_equal(as_rows(row), before):
        yield "changes an observation"


def the_last_executed_command_counts(estimator: EstimatorComponent) -> Iterator[str]:
    """Before the first observation none does."""
    row, state = scenes(PosedRoad()), estimator.init(CAR, DT)
    _, once = estimator.estimate(state, row[0])
    twice = estimator.executed(estimator.executed(once, 0.5), 0.1)
    once = estimator.executed(once, 0.1)
    one, other = (estimator.estimate(s, row[1])[0] for s in (once, twice))
    if not np.array_equal(as_row(one), as_row(other)):
        yield "of two commands passed to executed() not the last one counts"
    early = estimator.estimate(estimator.executed(state, 0.5), row[0])[0]
    if not np.array_equal(as_row(early), as_row(estimator.estimate(state, row[0])[0])):
        yield "executed() before the first observation changes the first estimate"


def exact_observations_pass(estimator: EstimatorComponent) -> Iterator[str]:
    """Where nothing is wrong and nothing is late, nothing is changed."""
    observations, steers = exact_drive()
    found = estimates(estimator, observations, steers)
    yield from differences(found, as_rows(observations))


def lost_samples_are_bridged(estimator: EstimatorComponent) -> Iterator[str]:
    """Every fourth sample is the last one again, and the estimate is that of the present."""
    observations, steers = exact_drive()
    row = [observations[k - 1 if k % 4 == 3 else k] for k in range(len(observations))]  # noqa: PLR2004
    yield from differences(estimates(estimator, row, steers), as_rows(observations))


SHARED = (
    a_loaded_one_estimates_alike,
    left_and_right_are_alike,
    any_finite_input_gives_finite_numbers,
    a_standing_car_stays,
    states_and_observations_are_left_alone,
    the_last_executed_command_counts,
    exact_observations_pass,
    lost_samples_are_bridged,
)
check: Contract[EstimatorComponent] = Contract(*SHARED)
