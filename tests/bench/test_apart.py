"""Training, tuning and test share neither roads nor ranges: that is so for what is shipped."""

from __future__ import annotations

from functools import cache
from pathlib import Path as FilePath

import pytest

from steersman import presets
from steersman.bench.standard import GENERATORS, standard
from steersman.bench.suite import Suite
from steersman.bench.suites import tuning
from steersman.learning.config import TrainConfig, load_preset, train_config
from steersman.paths.base import PathComponent
from steersman.studies.trials import TuneResult

RESULTS = FilePath(__file__).parents[2] / "results"
TESTED = [course.path for course in standard().courses.values()]


@cache
def trained() -> dict[str, TrainConfig]:
    """Every shipped preset, and what a training is without one."""
    found = {name: train_config(load_preset(name)) for name in presets.names()}
    return {**found, "default": TrainConfig()}


def roads(config: TrainConfig) -> list[PathComponent]:
    return [*config.problem.roads, *config.validation.roads]


def values(suite: Suite) -> dict[str, set[float]]:
    """What the disturbances of a suite set each number to that they change."""
    plain = {k: v for k, v in suite.disturbances["clean"].figures().items()}
    out: dict[str, set[float]] = {}
    for one in suite.disturbances.values():
        for name, value in one.figures().items():
            if isinstance(value, float) and value != plain.get(name, 0.0):
                out.setdefault(name, set()).add(value)
    return out


@pytest.mark.parametrize("name", [*presets.names(), "default"])
def test_no_training_has_a_road_of_the_test_or_its_generators(name: str) -> None:
    kinds = {path.kind for path in TESTED}
    assert kinds.isdisjoint(path.kind for path in roads(trained()[name]))
    assert {kind.kind for kind in GENERATORS.values()} <= kinds


def test_the_tuning_suite_has_roads_of_its_own_generator() -> None:
    own = {course.path.kind for course in tuning().courses.values()}
    assert own.isdisjoint(path.kind for path in TESTED)
    for config in trained().values():
        assert own.isdisjoint(path.kind for path in roads(config))


@pytest.mark.parametrize("folder", sorted((RESULTS / "tune").iterdir()), ids=str)
def test_no_shipped_gain_was_tuned_on_a_road_of_the_test(folder: FilePath) -> None:
    driven = TuneResult.read(folder / "result.json").suite
    kinds = {path.kind for path in TESTED}
    assert driven
    assert kinds.isdisjoint(run["path"]["kind"] for run in driven)


def test_the_tuning_suite_sees_every_class_of_disturbance_at_other_values() -> None:
    """What only says where or for how long may be equal."""
    tuned, tested = values(tuning()), values(standard())
    assert set(tested) - set(tuned) == set()
    for name, found in tested.items():
        assert found.isdisjoint(tuned[name]), name


def test_no_training_draws_from_the_ranges_of_the_test() -> None:
    (mixed,) = {one for one in standard().mixed.values()}
    for name, config in trained().items():
        spread = config.problem.spread
        for field in ("mass", "yaw_inertia", "stiffness", "delay"):
            assert getattr(spread, field) != getattr(mixed, field), (name, field)
