"""Random policies, a speed controller alone, the scenes of the contracts: for several tests."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path as FilePath

import numpy as np

from steersman.contracts.scenes import (
    CAR,
    CORNERS,
    DT,
    answers,
    beside,
    drive,
    observe,
    same,
    scenes,
)
from steersman.contracts.scenes import (
    PosedRoad as Posed,
)
from steersman.kernels.speed import pedals
from steersman.learning.config import TrainConfig
from steersman.learning.export import export_policy
from steersman.learning.networks import Net, view_net
from steersman.profiles import stack_profiles
from steersman.protocols import Path
from steersman.speed import SpeedComponent
from steersman.types import FloatArray, VehicleState

__all__ = [
    "CAR", "CORNERS", "DT", "PedalWork", "Posed", "answers", "beside", "drive", "observe",
    "odd_net", "random_net", "random_policy", "same", "scenes",
]  # fmt: skip


class PedalWork:
    """The longitudinal controller of one vehicle on a path, apart from any world."""

    def __init__(self, source: SpeedComponent, path: Path, dt: float, start: VehicleState) -> None:
        """The integral starts at the pedals of the steady turn."""
        self.table = stack_profiles([source.profile()], [path])
        self.path, self.dt, self.integral = path, dt, start.throttle - start.brake

    def __call__(self, car: VehicleState, s: float) -> tuple[float, float]:
        """Throttle and brake for the vehicle at arc length ``s`` [m]."""
        place = self.table, 0, self.path.table, 0, car.time, s, float(np.hypot(car.v_x, car.v_y))
        throttle, brake, self.integral = pedals(*place, self.integral, self.dt)
        return throttle, brake


def random_net(features: int, hidden: int = 8, seed: int = 0, actions: int = 1) -> Net:
    """An actor with random weights."""
    sizes = (features, hidden, hidden, actions)
    count = sum((a + 1) * b for a, b in pairwise(sizes))
    flat = np.random.default_rng(seed).normal(0.0, 0.3, count).astype(np.float32)
    return view_net(flat, sizes)


def odd_net(mirror: FloatArray, turned: FloatArray, hidden: int = 8) -> Net:
    """An actor with random weights that answers a mirrored scene with the mirrored actions.

    g(x) + turned g(mirror x), with the units of a random network g twice.
    """
    g = random_net(len(mirror), hidden, actions=len(turned))
    none = np.zeros_like(g.w2)
    return Net(
        w1=np.vstack([g.w1, g.w1 * mirror.astype(np.float32)]),
        b1=np.tile(g.b1, 2),
        w2=np.block([[g.w2, none], [none, g.w2]]),
        b2=np.tile(g.b2, 2),
        w3=np.hstack([g.w3, turned[:, None].astype(np.float32) * g.w3]),
        b3=np.zeros(len(turned), np.float32),
        flat=None,
    )


def random_policy(
    folder: FilePath, config: TrainConfig | None = None, *, odd: bool = False
) -> FilePath:
    """A policy file with random weights, for the problem of ``config``."""
    config = config or TrainConfig()
    layout = config.problem.layout
    if odd:
        return export_policy(odd_net(layout.mirror, config.problem.turned), config, folder, {})
    net = random_net(len(layout.scale), actions=len(config.problem.turned))
    return export_policy(net, config, folder, {})
