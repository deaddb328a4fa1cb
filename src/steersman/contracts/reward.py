"""What every term of the reward has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.contracts import Contract
from steersman.errors import SteersmanError
from steersman.kernels.formula import call, numbers_of
from steersman.learning.rewards import Judged, RewardTerm
from steersman.types import FloatArray

_COUNT = 50
# What does not change its sign where left and right are exchanged.
_EVEN = (
    *("speed", "v_x", "dt", "wished_speed", "a_x"),
    *("gap", "relative_speed", "wished_gap", "jerk"),
)


def it_is_what_it_declares(term: RewardTerm) -> Iterator[str]:
    """Finite, alike for left and right, proportional to its weight, compiled as in Python."""
    if not term.unit:
        yield "declares no unit"
    try:
        found = values(term, steps())
    except SteersmanError as error:
        yield str(error)
        return
    if not np.isfinite(found).all():
        yield "is not finite over finite steps"
    if not np.array_equal(found, values(term, steps())):
        yield "differs when the same steps are judged again"
    if not np.allclose(found, values(term, mirrored(steps())), rtol=1e-9, atol=1e-12):
        yield "prefers one side: the mirrored step earns something else"
    doubled = term.model_copy(update={"weight": 2.0 * term.weight})
    if not np.allclose(2.0 * found, values(doubled, steps()), rtol=1e-9, atol=1e-12):
        yield "does not double with its weight"
    if callable(getattr(type(term), "value", None)):
        plain = [term.value(Judged(*step.tolist())) for step in steps()]
        if not np.allclose(found, plain, rtol=1e-9, atol=1e-12):
            yield "compiled and as Python it differs"


check: Contract[RewardTerm] = Contract(it_is_what_it_declares)


def steps() -> FloatArray:
    """Steps (n, fields of :class:`Judged`) of a car about its path."""
    rng = np.random.default_rng(0)
    v_x, v_y = rng.uniform(1.0, 20.0, _COUNT), rng.normal(0.0, 0.3, _COUNT)
    columns = {
        name: rng.normal(0.0, size, _COUNT)
        for name, size in {
            "lateral_error": 0.5, "heading_error": 0.1, "curvature": 0.02, "yaw_rate": 0.3,
            "steer": 0.3, "previous_steer": 0.3, "demonstrated_steer": 0.3,
        }.items()
    }  # fmt: skip
    slip = np.arctan2(v_y, v_x)
    columns |= {"v_x": v_x, "v_y": v_y, "speed": np.hypot(v_x, v_y), "side_slip": slip}
    columns |= {
        "course_error": columns["heading_error"] + slip,
        "dt": np.full(_COUNT, 0.05),
        "wished_speed": rng.uniform(1.0, 20.0, _COUNT),
        "a_x": rng.normal(0.0, 2.0, _COUNT),
        "gap": rng.uniform(0.5, 60.0, _COUNT),
        "relative_speed": rng.normal(0.0, 3.0, _COUNT),
        "wished_gap": rng.uniform(3.0, 30.0, _COUNT),
        "jerk": rng.normal(0.0, 5.0, _COUNT),
    }
    return np.column_stack([columns[name] for name in Judged._fields])


def mirrored(given: FloatArray) -> FloatArray:
    """The same steps with left and right exchanged."""
    signs = [1.0 if name in _EVEN else -1.0 for name in Judged._fields]
    out: FloatArray = given * np.array(signs)
    return out


def values(term: RewardTerm, given: FloatArray) -> FloatArray:
    """What the term adds to the reward in each of some steps (n,)."""
    address, own = term.formula().address, np.array([*numbers_of(term).values()])
    return np.array([call(address, step, step, own, 0, 0, 0) for step in given])
