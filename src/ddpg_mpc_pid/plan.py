"""What is trained and what is driven, as data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Container
from functools import cache
from typing import Any, NamedTuple

import steersman as sm

# Counts up when stages measure something else: results of different formats are not mixed.
FORMAT = 1
UPDATES = 40_000
VEHICLES, PER_STEP = 8, 2
STEPS = UPDATES * VEHICLES // PER_STEP
# The paper's thresholds of mean error [m] in the question how much the demonstration saves, and
# two coarser ones.
THRESHOLDS = (0.5, 0.2, 0.1, 0.05, 0.01)

Departures = tuple[tuple[str, str], ...]
"""Settings over the preset "paper" in every training, each with its reason."""

DEPARTURES: Departures = (
    (f"steps={STEPS}", f"{UPDATES} updates a training, so that all fit into the time"),
    (f"agent.vehicles={VEHICLES}", "several vehicles collect at the same time"),
    (f"agent.updates={PER_STEP}", "one update for four environment steps"),
    ("agent.learning_starts=1000", "125 random steps of each vehicle, not 100 of one"),
    (f"agent.buffer={STEPS}", "holds every step, as the preset's does"),
    (
        "problem.speeds=[{kind: nedc, random_start: true, skip_standstill: true, a_lat_max: 12}]",
        "a short training would else see little but the cycle's slow beginning; and no car drives "
        "corners of 15 m at 120 km/h",
    ),
    ("problem.start=anywhere", "as episodes begin anywhere in the cycle"),
    ("problem.episode_time=60", "s; then a new place and speed"),
    ("validation={vehicles: 16, interval: 2500}", "finer curves; 8 random roads never trained on"),
    ("checkpoint_interval=20000", "what an interruption may cost"),
)

_NONE = ("problem.task.demonstration=none",)
_FIXED = ("problem.task.demonstration=fixed",)
_ALONE = ("problem.demonstration.p_action={kind: constant, at: 0}",)
_DIRECT = ("problem.action=direct",)
_PRECISE = ("problem.task={kind: precise, demonstration: adaptive}",)
_SHORT = (f"steps={UPDATES}",)
FULL_METHOD = "adaptive"


class Method(NamedTuple):
    """A way to train: its name in tables, and what it sets over the base."""

    label: str
    words: tuple[str, ...]
    reward: str
    """Methods of the same reward may be compared by their losses."""
    ablation: bool = False
    """Compared with the full method; with fewer seeds in the short plan."""

    @property
    def direct(self) -> bool:
        """Whether the action is the steering, not its rate."""
        return _DIRECT[0] in self.words


_BY_DEMONSTRATION: dict[str, Method] = {
    "ddpg": Method("DDPG alone", (*_NONE, "problem.demonstration.enabled=false"), "track"),
    "reward": Method("+ demonstration reward", (*_FIXED, *_ALONE), "fixed"),
    "action": Method("+ extra action", _NONE, "track"),
    "both": Method("+ both", _FIXED, "fixed"),
    "adaptive": Method("+ both, adaptive", (), "adaptive"),
    "direct": Method("+ both, adaptive, direct action", _DIRECT, "direct"),
}
_ABLATIONS: dict[str, Method] = {
    "sideslip": Method("Phi as side-slip", ("problem.task.phi=sideslip",), "sideslip", True),
    "store_agent": Method(
        "own action in the buffer", ("problem.demonstration.store=agent",), "adaptive", True
    ),
    "constant_rate": Method(
        "constant learning rate",
        ("agent.learning_rate={kind: constant, at: 1e-3}",),
        "adaptive",
        True,
    ),
    "precise": Method("reward with a finite slope at zero error", _PRECISE, "precise", True),
    "normalised": Method(
        "normalised coefficients", ("problem.task.normalise=true",), "normalised", True
    ),
    "scheduled": Method(
        "demonstrator with a model for each speed",
        ("problem.demonstration.controller={kind: mpc_pid, horizon: 20, scheduled: true}",),
        "adaptive",
        True,
    ),
}
# What only the plan as published trains: methods 1 to 4 with the direct action, equation 5 with a
# weight at which it matters, and the rewards by the length of the training.
_PUBLISHED: dict[str, Method] = {
    **{
        f"{name}_direct": method._replace(
            label=f"{method.label}, direct action",
            words=(*method.words, *_DIRECT),
            reward=f"{method.reward}, direct",
        )
        for name, method in list(_BY_DEMONSTRATION.items())[:4]
    },
    "change": Method(
        "+ both, adaptive, direct action, c_change = 100",
        (*_DIRECT, "problem.task.c_change=100"),
        "change",
        True,
    ),
    "adaptive_short": Method(f"+ both, adaptive, {UPDATES} updates", _SHORT, "adaptive", True),
    "precise_short": Method(
        f"reward with a finite slope, {UPDATES} updates", (*_PRECISE, *_SHORT), "precise", True
    ),
}
METHODS: dict[str, Method] = _BY_DEMONSTRATION | _ABLATIONS | _PUBLISHED
ALONE, _ALONE_DIRECT = "ddpg", "ddpg_direct"
# Rewards of the full method, after a short and after a whole training.
BY_LENGTH: dict[str, tuple[str, str]] = {
    "the paper's reward": ("adaptive_short", FULL_METHOD),
    "a finite slope at zero error": ("precise_short", "precise"),
}


def alone_beside(method: str, methods: Container[str]) -> str:
    """DDPG alone with the same action, if that is among ``methods``; else with the rate."""
    same = METHODS[method].direct and _ALONE_DIRECT in methods
    return _ALONE_DIRECT if same else ALONE


# Settings of the smoke run, over the departures.
_TINY = (
    "steps=600",
    "agent.hidden=[16, 16]",
    "agent.batch=32",
    "agent.learning_starts=100",
    "problem.episode_time=3",
    "validation={vehicles: 2, interval: 200}",
)


class Training(NamedTuple):
    """One training of the plan."""

    method: str
    seed: int
    config: sm.TrainConfig

    @property
    def name(self) -> str:
        """Its folder below ``runs``."""
        return f"{self.method}/seed_{self.seed}"


class Plan(NamedTuple):
    """All that decides what a reproduction measures."""

    methods: tuple[str, ...]
    seeds: int
    ablation_seeds: int
    departures: Departures
    words: tuple[str, ...]
    """Further settings of every training."""
    circle_seconds: float
    monza_seconds: float | None
    """None: a whole lap."""
    error_ranges: tuple[float, ...]
    """Waypoint errors [m]."""
    away_speeds: tuple[float, ...]
    """[m/s]"""
    away_tracks: tuple[str, ...]
    away_seconds: float | None
    """None: a whole lap."""
    horizons: tuple[int, ...]
    timed_steps: int
    """Control steps of the lap that are timed, at most."""
    solves: int
    """Solves of the MPC as users usually write it."""
    repetitions: int
    """Of the bootstrap."""

    def trainings(self) -> tuple[Training, ...]:
        """Every training; one seed of all methods first, so that an early look shows them all."""
        return _trainings(self)

    def data(self) -> dict[str, Any]:
        """The plan as plain data, every configuration resolved."""
        configs = {t.name: sm.dump(t.config) for t in self.trainings()}
        return {"format": FORMAT, **self._asdict(), "trainings": configs}

    def digest(self) -> str:
        """SHA-256 of the plan."""
        text = json.dumps(self.data(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


@cache
def _trainings(plan: Plan) -> tuple[Training, ...]:
    found = []
    for seed in range(max(plan.seeds, plan.ablation_seeds)):
        for name in plan.methods:
            method = METHODS[name]
            if seed < (plan.ablation_seeds if method.ablation else plan.seeds):
                base = (*(word for word, _ in plan.departures), *plan.words)
                words = (*base, *method.words, f"seed={seed}")
                last = {word.partition("=")[0]: word for word in words}  # later ones win
                config = sm.configure("train", "paper", *last.values())
                found.append(Training(name, seed, config))
    return tuple(found)


def full() -> Plan:
    """The whole study, in trainings that are short enough for an evening."""
    return Plan(
        methods=(*_BY_DEMONSTRATION, *_ABLATIONS),
        seeds=5,
        ablation_seeds=3,
        departures=DEPARTURES,
        words=(),
        circle_seconds=60.0,
        monza_seconds=None,
        error_ranges=(0.0, 0.1, 0.2, 0.3, 0.4, 0.5),
        away_speeds=(6.0, 30.0 / 3.6, 12.0, 16.0, 20.0, 25.0, 30.0),
        away_tracks=("training_circuit", "circle", "monza"),
        away_seconds=None,
        horizons=(10, 20, 40),
        timed_steps=20_000,
        solves=300,
        repetitions=2000,
    )


def published() -> Plan:
    """Every training as published: the preset "paper" and nothing else, five seeds each."""
    methods = (*_BY_DEMONSTRATION, *_PUBLISHED, "precise")
    return full()._replace(methods=methods, ablation_seeds=5, departures=())


def only(plan: Plan, methods: tuple[str, ...] | None, seeds: int | None) -> Plan:
    """A part of a plan: some of its methods, and so many seeds of each at most.

    Raises:
        sm.ConfigError: the plan has no such method.
    """
    chosen = plan.methods if methods is None else methods
    for name in chosen:
        if name not in plan.methods:
            raise sm.ConfigError(
                f"--methods: this plan has no {name!r}{sm.suggestion(name, plan.methods)}"
            )
    most = max(plan.seeds, plan.ablation_seeds) if seeds is None else seeds
    return plan._replace(
        methods=chosen,
        seeds=min(plan.seeds, most),
        ablation_seeds=min(plan.ablation_seeds, most),
    )


def quick() -> Plan:
    """A smoke run: every stage, nearly nothing in it."""
    return full()._replace(
        methods=("ddpg", "both", "adaptive"),
        seeds=1,
        ablation_seeds=1,
        words=_TINY,
        circle_seconds=2.0,
        monza_seconds=4.0,
        error_ranges=(0.0, 0.2),
        away_speeds=(30.0 / 3.6, 16.0),
        away_tracks=("training_circuit",),
        away_seconds=3.0,
        horizons=(10, 20),
        timed_steps=50,
        solves=3,
        repetitions=50,
    )
