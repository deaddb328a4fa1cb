"""What holds for every registered component. A new one is found here with no further edit."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path as FilePath
from typing import Any

import pytest
from pydantic import field_serializer

from steersman import contracts
from steersman.config import build, components, families, resolve
from steersman.contracts import controller as contract
from steersman.contracts import path
from steersman.contracts.controller_faults import STEERED
from steersman.controllers.base import ControllerComponent
from steersman.disturbances import DisturbanceComponent, Disturber
from steersman.encoding import EncodingComponent
from steersman.errors import ConfigError
from steersman.features.base import Feature
from steersman.features.motion import YawRate
from steersman.learning.config import TrainConfig
from steersman.learning.schedules import Schedule
from steersman.paths.analytic import Circle
from steersman.types import Observation

from .loops import Posed, random_policy, scenes

OUTSIDE = [sys.executable, "-I", "-S", str(FilePath(__file__).with_name("outside.py"))]
# Further settings of kinds whose defaults leave code aside.
VARIANTS: dict[str, dict[str, Any]] = {
    "estimated-predicted": {"kind": "estimated", "predictor": "single_track"},
    "mpc-limits": {"kind": "mpc", "rate_limit": True, "corridor": 0.2, "scheduled": True},
    "mpc_delay-given": {"kind": "mpc_delay", "delay": 0.12},
    "mpc_delay-plain": {"kind": "mpc_delay", "disturbance_time": None},
    "mpc_pid-limits": {"kind": "mpc_pid", "rate_limit": True, "corridor": 0.2},
    "mpc_pid-scheduled": {"kind": "mpc_pid", "scheduled": True},
    "mpc_pid-wrong": {"kind": "mpc_pid", "model_error": {"mass": 1.3, "c_r": 0.8}},
    "policy-residual": {"kind": "policy"},
    "pid-feedforward": {"kind": "pid", "feedforward": True, "k_heading": 0.3},
    "pure_pursuit-centre": {"kind": "pure_pursuit", "track": "centre_of_mass"},
    "stanley-centre": {"kind": "stanley", "track": "centre_of_mass", "steer_damping": 0.2},
}
ALL = {**{kind: {"kind": kind} for kind in components("controller")}, **VARIANTS}
PROBLEMS: dict[str, dict[str, Any]] = {
    "policy": {},
    "policy-residual": {"action": "residual", "base": "mpc_delay", "authority": 0.3},
    "adaptive": {
        "action": "parameters",
        "base": "tuned/mpc_delay",
        "parameters": {"r_change": "1..10:log", "horizon": "10|20|30"},
        "period": 3,
        "demonstration": {"enabled": False},
    },
}


@pytest.fixture(scope="session")
def policies(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Files of policies by the names of controllers.

    Their networks are odd, which is a matter of training, not of the code; what is around them has
    to treat left and right alike.
    """
    return {
        name: str(
            random_policy(
                tmp_path_factory.mktemp(name),
                build(TrainConfig, {"problem": fields}),
                odd=True,
            )
        )
        for name, fields in PROBLEMS.items()
    }


def make(name: str, policies: Mapping[str, str]) -> ControllerComponent:
    fields = dict(ALL[name])
    if name in policies:
        fields["file"] = policies[name]
    if name == "process":
        fields["command"] = OUTSIDE
    controller = resolve("controller", fields)
    assert isinstance(controller, ControllerComponent)
    return controller


@pytest.fixture(params=ALL)
def controller(request: pytest.FixtureRequest, policies: dict[str, str]) -> ControllerComponent:
    """Each controller in turn."""
    return make(request.param, policies)


@pytest.mark.parametrize(
    "check", [*contract.check.checks, *contract.NOT_OF_NETWORKS], ids=lambda check: check.__name__
)
def test_controllers_keep_their_contract(
    controller: ControllerComponent, check: Callable[[ControllerComponent], Iterator[str]]
) -> None:
    if controller.kind == "policy" and check in STEERED:
        pytest.skip("a network of random weights")
    assert list(check(controller)) == []


@pytest.mark.parametrize("check", STEERED[:2], ids=lambda check: check.__name__)
def test_the_policy_of_the_package_bears_outliers_and_standstill(
    check: Callable[[ControllerComponent], Iterator[str]],
) -> None:
    policy = resolve("controller", "policy")
    assert isinstance(policy, ControllerComponent)
    assert list(check(policy)) == []


def test_observations_know_no_place_and_direction() -> None:
    moved = Posed(x=-350.0, y=120.0, psi=2.4)
    for a, b in zip(scenes(Posed()), scenes(moved), strict=True):
        assert a[:8] == pytest.approx(b[:8], abs=1e-10)
        assert a.preview == pytest.approx(b.preview, abs=1e-10)


# Their components are checked in tests of their own: each with settings, or slowly.
ELSEWHERE = {"agent", "controller", "feature", "metric", "path", "plant", "reward", "task"}


@pytest.mark.parametrize("family", sorted({*families()} - ELSEWHERE))
def test_every_component_of_a_family_keeps_its_contract(family: str) -> None:
    found = list(contracts.check_family(family))
    assert [each.name for each in found] == [f"{family}.{kind}" for kind in components(family)]
    assert [each for each in found if each.findings] == []
    assert all("file: required" in each.left_out for each in found if each.left_out)


def test_every_family_has_a_contract() -> None:
    assert contracts.contracts() == families()


def test_what_needs_a_file_or_a_server_is_left_out() -> None:
    left = {each.name: each.left_out for each in contracts.check_family("plant")}
    assert left["plant.simulator"] is None
    assert "needs a server" in str(left["plant.carla"])


class Forgetful(Schedule):
    """A schedule that counts its calls."""

    def value(self, step: float, total: float) -> float:
        calls.append(step)
        return float(len(calls))


calls: list[float] = []


class Idle(DisturbanceComponent):
    """A disturbance that does nothing."""

    strength: float = 0.0

    def make(self, n: int, seed: int) -> Disturber:
        return Disturber()


class Twice(EncodingComponent):
    """An encoding that lists a feature twice."""

    def features_for(self, action: str) -> tuple[Feature, ...]:
        return (YawRate(), YawRate())


class Forgets(Circle):
    """A path whose radius is lost on the way through a file."""

    @field_serializer("radius")
    def _lost(self, radius: float) -> float:
        return 50.0


@pytest.mark.parametrize(
    ("family", "component", "finding"),
    [
        (
            "schedule",
            Forgetful(),
            "a value depends on the step alone: gives other values",
        ),
        ("disturbance", Idle(), "it disturbs: changes nothing in a drive of 5 s"),
        ("encoding", Twice(), "action rate: a name is there twice"),
        ("path", Forgets(radius=30.0), "loading undoes dumping: its plain data give another one"),
    ],
)
def test_what_breaks_a_contract_is_named(family: str, component: Any, finding: str) -> None:
    check = importlib.import_module(f"steersman.contracts.{family}").check
    assert any(text.startswith(finding) or finding in text for text in check(component))


class Lefty(ControllerComponent):
    """A controller that breaks much: it remembers by itself, and steers to the left alone."""

    def init(self, vehicle: object, dt: float) -> list[float]:
        return []

    def decide(self, state: Any, observation: Observation) -> tuple[float, Any, Any]:
        state.append(observation.lateral_error)
        return 0.1 * len(state), contract.Status.SOLVED, state


def test_a_controller_that_breaks_its_contract_is_found_out() -> None:
    found = " ".join(contract.check(Lefty()))
    assert "left and right are not steered alike" in found
    assert "the same state and observation give two answers" in found


class Grudging(ControllerComponent):
    """It steers by all side velocities that it has ever seen."""

    def init(self, vehicle: object, dt: float) -> float:
        return 0.0

    def decide(self, state: float, observation: Observation) -> tuple[float, Any, float]:
        state += observation.v_y
        return 0.1 * state, contract.Status.SOLVED, state


def test_a_controller_that_an_outlier_moves_for_long_is_found_out() -> None:
    found = list(STEERED[0](Grudging()))
    assert len(found) == 2
    assert found[0].startswith("10 steps after v_y = 5")


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("controller.lqr", "controller.lqr"),
        ("tuned/lqr", "controller.lqr"),
        ("circle", "path.circle"),
        ("vehicle.bmw_320i", "vehicle.bmw_320i"),
    ],
)
def test_check_takes_words(word: str, name: str) -> None:
    assert contracts.check(word) == (name, [])


def test_wrong_words_of_check_are_one_line() -> None:
    with pytest.raises(ConfigError, match=r"'csv' is in several families; write path"):
        contracts.check("csv")
    with pytest.raises(ConfigError, match=r"unknown component 'controller\.lqrr'; did you mean"):
        contracts.check("controller.lqrr")
    with pytest.raises(ConfigError, match="engine: has no contract; families that have: "):
        list(contracts.check_family("engine"))


def test_a_path_that_does_not_join_is_found_out() -> None:
    from steersman.paths.segments import Segment, from_segments

    class Broken(path.PathComponent):
        def build_table(self) -> Any:
            table = from_segments([Segment(50.0, 0.0, 0.0), Segment(50.0, 0.02, 0.02)])
            table.pieces[-3:, 1] += 0.5
            return table

    assert any("pieces are" in text for text in path.check(Broken()))
