"""A speed that grip allows: with a known friction, and with one that a drive finds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.config import build, resolve
from steersman.controllers.grip_speed import GripSpeed
from steersman.controllers.pid import Pid
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.kernels.vehicle import GRAVITY
from steersman.rollout import RunConfig, attempt
from steersman.types import Observation
from steersman.vehicles import CarlaModel3

from ..loops import DT

FOUND = {"kind": "grip_speed", "inner": "tuned/mpc_delay", "found": True}


def on_a_bend(
    controller: Any, friction: float, seconds: float, car: str = "carla_model3"
) -> Episode:
    """From standstill into a road of bends, where 20 m/s are wished."""
    words: dict[str, Any] = {
        "path": {"kind": "circle", "radius": 30.0},
        "speed": {"kind": "stop_and_go", "speed": 20.0, "stand": 0.1, "hold": 1e3},
        "vehicle": {"kind": car, "friction": friction},
        "nominal": car,
        "sensor": {"count": 41},
        "duration": seconds,
    }
    run = build(RunConfig, words)
    return attempt(run.model_copy(update={"controller": controller})).of_controller()


def test_with_a_known_friction_it_is_what_the_bend_allows() -> None:
    controller = GripSpeed(inner=Pid(), friction=0.5)
    episode = on_a_bend(controller, 3.0, 14.0)
    allowed = np.sqrt(controller.used * 0.5 * GRAVITY * 30.0)
    assert episode["v_x"][-1] == pytest.approx(allowed, abs=0.3)


def test_what_finds_no_friction_is_refused() -> None:
    with pytest.raises(ConfigError, match="finds no friction"):
        build(GripSpeed, {"inner": "pid", "found": True})
    with pytest.raises(ConfigError, match="and let 'estimated' hold grip_speed"):
        build(GripSpeed, {"inner": "estimated", "found": True})
    with pytest.raises(ConfigError, match="at most 2"):
        build(GripSpeed, {"found": True, "least": 3.0})
    nominal = GripSpeed(inner=Pid()).init(CarlaModel3(), DT)
    assert nominal.belief.friction == CarlaModel3().friction


@pytest.mark.parametrize("car", ["carla_model3", "bmw_320i"])
@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_a_friction_that_nothing_tells_is_found(friction: float, car: str) -> None:
    """Where a car as fast as wished leaves the road, it uses much of the grip and never all.

    The BMW drives its rear wheels and should have a friction of 1, the Model 3 all and 3.
    """
    episode = on_a_bend(resolve("controller", FOUND), friction, 25.0, car)
    assert episode.completed
    used = episode["v_x"] ** 2 / 30.0 / (friction * GRAVITY)
    assert 0.4 < used[-1] < 1.0
    assert np.abs(episode["lateral_error"]).max() < 0.5
    assert not on_a_bend(resolve("controller", FOUND["inner"]), friction, 12.0, car).completed


def test_what_is_reckoned_with_grows_slowly_once_it_is_much_and_falls_at_once() -> None:
    """Below ``cautious`` at most at ``growth``, above at ``slow_growth``; a slide is for ever."""
    controller = resolve("controller", FOUND)
    assert isinstance(controller, GripSpeed)
    belief = controller.believed(CarlaModel3())
    seen = Observation(0.0, 0.0, 0.0, 15.0, 0.0, 0.6, 0.0, 0.04, np.zeros((9, 2)), 2.0)
    rates = []
    for _ in range(400):
        last, belief = belief, controller.shown(belief, seen, 3.0, DT)
        rates.append((last.friction, (belief.friction / last.friction - 1.0) / DT))
    assert belief.friction > controller.cautious
    for friction, rate in rates:
        most = controller.growth if friction < controller.cautious else controller.slow_growth
        assert -1e-9 <= rate <= most + 1e-9
    slid = controller.shown(belief, seen, 0.3, DT)
    assert slid.friction == pytest.approx(max(0.8 * 0.3, controller.least))
    for _ in range(200):
        slid = controller.shown(slid, seen, 3.0, DT)
    assert slid.friction == pytest.approx(max(0.8 * 0.3, controller.least))
