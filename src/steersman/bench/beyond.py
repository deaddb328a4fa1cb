"""The suite ``beyond_grip``: bends that grip does not suffice for at the wished speed.

Its roads are of the three generators that no training and no tuning uses, with other seeds than
those of ``standard``. On wet road and on ice the wished speeds ask in bends for 15 % or 40 % more
than the whole grip; on a dry road with icy patches for a third more than the patches have. Neither
friction nor patches are part of what controllers get. Only a slower car stays on such a road.
"""

from __future__ import annotations

from steersman.bench.disturbance import Disturbance
from steersman.bench.standard import GENERATORS
from steersman.bench.suite import Course, Suite
from steersman.disturbances import FrictionPatch
from steersman.speed import StopAndGo

FRICTION = {"wet": 0.7, "ice": 0.3}
"""Tyre friction by the word for the road."""
_SEEDS = range(100, 104)
_DISTANCE = 400.0
# From standstill, so that no drive begins in a bend with too much speed.
WISHED = StopAndGo(speed=20.0, stand=0.5, hold=1e3, a_lat_max=30.0)


def beyond_grip() -> Suite:
    """The suite."""
    courses = {
        f"{name}_{seed}": Course(
            path=kind(seed=seed, distance=_DISTANCE), speeds={"wished": WISHED}
        )
        for name, kind in GENERATORS.items()
        for seed in _SEEDS
    }
    patches = FrictionPatch(begin=30.0, length=40.0, every=90.0, left=0.45, right=0.45)
    return Suite(
        courses=courses,
        disturbances={
            **{
                f"{word}_{used:g}": Disturbance(friction=friction, used_grip=used, used_along=None)
                for word, friction in FRICTION.items()
                for used in (1.15, 1.4)
            },
            "icy_patches": Disturbance(
                friction=1.0, used_grip=0.6, used_along=None, disturbances=(patches,)
            ),
        },
    )
