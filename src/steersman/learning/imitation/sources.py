"""Samples for an imitation, and demonstrations: from driving, or from data that were recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Any, NamedTuple, Protocol

import numpy as np

from steersman.config import dump
from steersman.errors import ConfigError
from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.learning.datasets.recorder import Recorder
from steersman.learning.datasets.source import load
from steersman.learning.datasets.trajectory import Trajectory, Who, actions_for, features, steps
from steersman.learning.fleet import FleetDriver
from steersman.learning.imitation.config import ImitationConfig
from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.problem import Problem
from steersman.learning.validate import Score, Validator
from steersman.plants.mover import Shared
from steersman.types import FloatArray

Act = Callable[[Any], Any]
SIGMA = 0.1
"""Noise on the actions of demonstrations."""
_THETA = 0.15


class Dataset(NamedTuple):
    """What a network is fitted to, wherever it comes from."""

    features: Any
    """(n, k) float32, the network's input: scaled and clipped."""
    actions: Any
    """(n,) float32 in [-1, 1], the output that it is fitted to."""

    @classmethod
    def empty(cls, features: int) -> Dataset:
        """No samples yet."""
        return cls(np.zeros((0, features), np.float32), np.zeros(0, np.float32))

    def joined(self, other: Dataset) -> Dataset:
        """These samples, then the other's."""
        return Dataset(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


class Drives(NamedTuple):
    """What was seen in a round of driving."""

    data: Dataset
    mean_error: float
    """Mean |lateral error| of all steps [m]."""
    off_track: int
    """Episodes that ended off the road or rolled over."""
    difference: float
    """RMS difference between the network's action and the demonstrator's in the states visited [-]:
    the error of the fit on samples that it has not seen. NaN without a network."""
    demonstrated: float
    """Share of the steps in which the demonstrator's action was executed."""


class Driving(NamedTuple):
    """How the actions of a round are chosen."""

    network: Callable[[Any], Any] | None
    """Maps features (n, k) to actions (n,); None: there is none yet."""
    beta: float
    """Probability that the demonstrator's action is executed; drawn for each vehicle and step."""
    sigma: float
    """Noise on what is executed (Ornstein-Uhlenbeck, of the action's range)."""
    theta: float
    """Its return to zero per step."""


def collect(
    driver: FleetDriver,
    driving: Driving,
    steps: int,
    seeds: Sequence[int],
    tick: Callable[[float], None],
    recorder: Recorder | None = None,
) -> Drives:
    """Drive ``steps`` control steps with every vehicle, from new episodes on.

    The label of a state is the demonstrator's action there, whichever is executed.
    The same arguments collect the same samples.

    Args:
        driver: the vehicles.
        driving: how actions are chosen.
        steps: control steps of each vehicle.
        seeds: of the choice between network and demonstrator, of the noise, of the vehicles.
        tick: called with the share done.
        recorder: records every step as well.
    """
    fleet, n = driver.fleet, driver.n
    rng = np.random.default_rng(int(seeds[0]))
    noise = OrnsteinUhlenbeck(n, driving.theta, lambda: driving.sigma, 1.0, int(seeds[1]))
    driver.seed(int(seeds[2]))
    for i in range(n):
        driver.reset(i)
    features = np.empty((steps, n, fleet.inputs.shape[1]), np.float32)
    actions = np.empty((steps, n), np.float32)
    error, off_track, squares, demonstrated = 0.0, 0, 0.0, 0
    for k in range(steps):
        labels = driver.demonstrated_actions()
        features[k], actions[k] = fleet.inputs, labels
        own, demonstrates = np.full(n, np.nan), np.ones(n, dtype=bool)
        if driving.network is not None:
            own, demonstrates = driving.network(fleet.inputs), rng.random(n) < driving.beta
            squares += float(((own - labels) ** 2).sum())
        demonstrated += int(demonstrates.sum())
        executed = np.clip(np.where(demonstrates, labels, own) + noise()[:, 0], -1.0, 1.0)
        if recorder is not None:
            recorder.choose(executed, own, demonstrates)  # the demonstrator's number is one
        driver.step(executed)
        if recorder is not None:
            recorder.stepped()
        error += float(np.abs(fleet.tracking[:, observe.D]).sum())
        for i in np.flatnonzero(fleet.ended != kernel.RUNNING).tolist():
            off_track += int(fleet.ended[i]) in kernel.FAILED
            driver.reset(i)
            noise.reset(i)
        tick((k + 1) / steps)
    count = steps * n
    return Drives(
        Dataset(features.reshape(count, -1), actions.reshape(count)),
        error / count,
        off_track,
        float("nan") if driving.network is None else (squares / count) ** 0.5,
        demonstrated / count,
    )


def demonstrate(
    problem: Problem,
    steps: int,
    seed: int,
    *,
    vehicles: int = 16,
    sigma: float = SIGMA,
    tick: Callable[[float], None] | None = None,
) -> list[Trajectory]:
    """Episodes of at least ``steps`` steps together, driven by the problem's demonstrator.

    Noise on what is executed shows how the demonstrator comes back (Laskey et al., DART, CoRL
    2017); the demonstrated actions are without it. The same arguments give the same episodes.

    Args:
        problem: roads, cars and demonstrator.
        steps: environment steps of all vehicles together.
        seed: of starts, speeds, cars, sensor errors and noise.
        vehicles: vehicles that drive at the same time in the embedded simulator.
        sigma: noise (Ornstein-Uhlenbeck), of the action's range.
        tick: called with the share done.

    Raises:
        ConfigError: the problem has no demonstrator.
    """
    if not problem.demonstration.enabled:
        raise ConfigError("is false; set it to true", ("problem", "demonstration", "enabled"))
    n = vehicles if problem.plant.embedded else 1
    seeds = [0, *np.random.SeedSequence(seed).generate_state(2).tolist()]
    shown = Driving(network=None, beta=1.0, sigma=sigma, theta=_THETA)
    with closing(FleetDriver(problem, n)) as driver:
        recorder = Recorder(driver)
        collect(driver, shown, -(-steps // n), seeds, tick or (lambda _: None), recorder)
        return recorder.take()


class SampleSource(Protocol):
    """Gives samples, round by round."""

    per_round: int
    """What a round adds to the steps that are counted."""
    shared: Shared | None
    """The plant that the validation has to drive, too; None: one of its own."""

    def judge(self) -> Score | None:
        """Validation of what is imitated; None if it cannot be driven."""

    def announce(self, judged: Score | None) -> str:
        """What is imitated, in a sentence."""

    def round(
        self, k: int, act: Act, seed: np.random.SeedSequence, tick: Callable[[float], None]
    ) -> Drives:
        """New samples of round ``k``; ``act`` is the network, used from the second round on."""

    def note(self) -> dict[str, Any]:
        """What a policy's card says of it."""

    def close(self) -> None:
        """Release the plant, if there is one."""


class Driven:
    """Samples of driving: by the demonstrator, from the second round on by the network."""

    def __init__(self, config: ImitationConfig) -> None:
        """Make the vehicles."""
        self._config = config
        self._driver = FleetDriver(config.problem, config.vehicles)
        self.per_round = config.round_steps * config.vehicles
        self.shared: Shared | None = self._driver.mover.shared

    def judge(self) -> Score:
        """The demonstrator, through the same action as the network."""
        config = self._config
        judge = Validator(config.problem, config.validation, self.shared, demonstrated=True)
        return judge.score_demonstrator()

    def announce(self, judged: Score | None) -> str:
        """How the demonstrator drives."""
        assert judged is not None
        kind = self._config.problem.demonstration.controller.kind
        return f"{kind} itself on the validation drives: {score_text(judged)}"

    def round(
        self, k: int, act: Act, seed: np.random.SeedSequence, tick: Callable[[float], None]
    ) -> Drives:
        """Drive; in the first round there is no network yet."""
        config = self._config
        total, done = self.per_round * config.rounds, k * self.per_round
        sigma = config.noise.value(done, total)
        beta = 1.0 if config.method == "bc" else config.beta.value(done, total)
        driving = Driving(act if k else None, beta, sigma, config.noise_theta)
        seeds = seed.generate_state(3).tolist()
        return collect(self._driver, driving, config.round_steps, seeds, tick)

    def note(self) -> dict[str, Any]:
        """The demonstrator."""
        return {"demonstrator": dump(self._config.problem.demonstration.controller)}

    def close(self) -> None:
        """Release the plant, if there is one."""
        self._driver.close()


class Given:
    """Data that were recorded; all of them are there from the first round on."""

    shared: Shared | None = None

    def __init__(self, config: ImitationConfig) -> None:
        """Read them.

        Raises:
            DataError: they cannot be read, or hold no drive.
            ConfigError: the problem is another one.
        """
        self._config = config
        self._drives = load(config.problem, config.data, config.ahead)
        self._steps = steps(self._drives)
        self.per_round = -(-self._steps // config.rounds)
        parts = [samples(config.problem, one, config.label) for one in self._drives]
        self._data = Dataset(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def judge(self) -> None:
        """The driver of recorded data cannot drive the validation."""

    def announce(self, judged: Score | None) -> str:
        """How much there is, and the shares of its drivers."""
        who = np.concatenate([one.driver for one in self._drives])
        shares = [f"{np.mean(who == w):.0%} by {w.name.lower()}" for w in Who if np.any(who == w)]
        names = ", ".join(self._config.data)
        return f"{self._steps} steps of {len(self._drives)} drives, {', '.join(shares)}: {names}"

    def round(
        self, k: int, act: Act, seed: np.random.SeedSequence, tick: Callable[[float], None]
    ) -> Drives:
        """All samples in the first round, none later."""
        data, ended = self._data, sum(one.terminated for one in self._drives)
        gap = float(np.sqrt(np.mean((act(data.features) - data.actions) ** 2))) if k else np.nan
        errors = np.concatenate([one.places[:-1, 0] for one in self._drives])
        who = np.concatenate([one.driver for one in self._drives])
        return Drives(
            data=data if k == 0 else Dataset.empty(data.features.shape[1]),
            mean_error=float(np.mean(np.abs(errors))),
            off_track=ended if k == 0 else 0,
            difference=gap,
            demonstrated=float(np.mean(who != Who.OWN)),
        )

    def note(self) -> dict[str, Any]:
        """What was learned from."""
        return {"data": list(self._config.data), "label": self._config.label}

    def close(self) -> None:
        """There is no plant."""


def samples(problem: Problem, one: Trajectory, label: str) -> Dataset:
    """A drive as samples of the problem's policy.

    The label ``demonstrated`` is the demonstrator's action, or where there is none the executed.
    """
    wanted: FloatArray = one.steer
    if label == "demonstrated":
        wanted = np.where(np.isfinite(one.demonstrated_steer), one.demonstrated_steer, one.steer)
    actions = actions_for(problem, one.rows, one.steer, wanted)
    seen = features(problem, one.rows, one.steer)[:-1]
    return Dataset(seen, np.clip(actions, -1.0, 1.0).astype(np.float32))


def score_text(score: Score) -> str:
    """A validation in a few words."""
    return (
        f"RMS error {1e3 * score.rms_error:.4g} mm, mean {1e3 * score.mean_error:.4g} mm, "
        f"{score.failures} failed, RMS steering change {score.steer_activity:.4f}"
    )
