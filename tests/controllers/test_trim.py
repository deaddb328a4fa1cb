"""The integral loop around a policy's network."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.config import build
from steersman.controllers.policy import Policy
from steersman.episode import Episode
from steersman.learning.config import TrainConfig
from steersman.learning.export import export_policy
from steersman.learning.networks import Net
from steersman.paths.analytic import Straight
from steersman.rollout import RunConfig, run

from ..loops import CAR, DT, beside, observe, random_net

OFFSET = 0.05
DIRECT = {"action": "direct", "encoding": {"kind": "extended"}}


@pytest.fixture
def content_beside(tmp_path: FilePath) -> str:
    """A network that steers the car to 50 mm left of the path that it is told."""
    config = build(TrainConfig, {"problem": DIRECT, "trim": 1.0})
    names, scale = config.problem.layout.names, config.problem.layout.scale
    law = np.zeros((1, len(names)))
    for name, gain in (("lateral_error [m]", -0.1), ("heading_error [rad]", -0.5)):
        law[0, names.index(name)] = gain / scale[names.index(name)]
    both_ways = np.array([1.0, -1.0])
    net = Net(
        w1=both_ways[:, None] * law,
        b1=both_ways * 0.1 * OFFSET,
        w2=np.eye(2),
        b2=np.zeros(2),
        w3=both_ways[None, :],
        b3=np.zeros(1),
        flat=None,
    )
    return str(export_policy(net, config, tmp_path, {}))


def driven(file: str, **fields: float) -> Episode:
    """40 s on a straight."""
    words = {
        "controller": {"kind": "policy", "file": file, **fields},
        "path": {"kind": "straight"},
        "speed": {"kind": "constant_speed", "speed": 8.0},
        "duration": 40.0,
    }
    return run(build(RunConfig, words))


def settled(file: str, **fields: float) -> float:
    """Lateral error at the end [m]."""
    return float(driven(file, **fields)["lateral_error"][-1])


def test_it_takes_away_the_offset_at_which_a_network_settles(content_beside: str) -> None:
    assert settled(content_beside, trim=0.0) == pytest.approx(OFFSET, abs=1e-3)
    assert settled(content_beside) == pytest.approx(0.0, abs=1e-5)  # as the card says
    assert settled(content_beside, trim=0.5) == pytest.approx(0.0, abs=1e-4)


def test_it_stops_at_its_limit(content_beside: str) -> None:
    assert settled(content_beside, trim_limit=0.02) == pytest.approx(OFFSET - 0.02, abs=1e-3)


def test_it_settles_with_the_time_constant_of_its_rate(content_beside: str) -> None:
    error = driven(content_beside, trim=0.05)["lateral_error"]
    later = error[600] / error[200]  # 20 s
    assert later == pytest.approx(math.exp(-0.05 * 20.0), rel=0.05)


def test_it_moves_no_faster_than_its_speed(content_beside: str) -> None:
    error = driven(content_beside, trim=10.0, trim_speed=1e-3)["lateral_error"]
    assert error[700] - error[600] == pytest.approx(-1e-3 * 5.0, rel=0.02)


def test_a_base_is_told_of_the_shifted_path(tmp_path: FilePath) -> None:
    """A PD controller that is misaligned settles beside the path; without correction, too."""
    base = {"kind": "pid", "gains": {"k_p": 0.1, "k_i": 0.0, "k_d": 0.05}}
    config = build(TrainConfig, {"problem": {"action": "residual", "base": base, "authority": 0.1}})
    net = random_net(len(config.problem.layout.scale))
    net.w3[:], net.b3[:] = 0.0, 0.01
    file = str(export_policy(net, config, tmp_path, {}))
    beside_path = 0.1 * math.tanh(0.01) / 0.1
    assert settled(file, trim=0.0) == pytest.approx(beside_path, rel=0.05)
    assert settled(file, trim=1.0) == pytest.approx(0.0, abs=1e-4)


def test_waypoints_and_error_are_shifted_together(content_beside: str) -> None:
    """What the network is told is what it would be told on a path so far to the right."""
    controller, path = Policy(file=content_beside, trim_speed=1.0), Straight()
    state = controller.init(CAR, DT)
    there = observe(path, beside(path, 5.0, d=0.1), 5.0)
    steer, _, _ = controller.decide(state._replace(shift=0.1), there)
    farther = observe(path, beside(path, 5.0, d=0.1 + 0.1 + DT * 0.1), 5.0)
    plain = Policy(file=content_beside, trim=0.0)
    assert steer == pytest.approx(plain.decide(plain.init(CAR, DT), farther)[0])
