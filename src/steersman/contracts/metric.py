"""What every metric has to fulfil; for packages with metrics of their own, too."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from steersman.contracts import Contract
from steersman.episode import COLUMNS, DURATION, OFF_TRACK, Episode
from steersman.metrics.base import Metric
from steersman.types import FloatArray

# Columns whose sign changes when a drive is mirrored at the x axis.
LATERAL = (
    *("y", "psi", "v_y", "yaw_rate", "a_y", "lateral_error", "heading_error", "course_error"),
    *("curvature", "path_y", "steer_command", "steer", "wheel_angle"),
)
_DT, _ROWS = 0.05, 120


def it_is_declared(metric: type[Metric]) -> Iterator[str]:
    """Unit, meaning, and which values are better."""
    if not metric.unit or not metric.meaning:
        yield "declares no unit or no meaning"
    if metric.better not in {None, "lower", "higher"}:
        yield f"better is {metric.better!r}; allowed: 'lower', 'higher', None"


def it_keeps_the_conventions(metric: type[Metric]) -> Iterator[str]:
    """Those of docs/metrics.md, over drives of all lengths, with gaps and mirrored."""
    for name, episode in _episodes().items():
        before = {key: values.copy() for key, values in episode.columns.items()}
        try:
            value, again = metric.of(episode), metric.of(episode)
            mirrored = metric.of(_mirrored(episode))
        except Exception as error:  # noqa: BLE001 - whatever it raises is the finding
            yield f"raises {type(error).__name__} over {name}: {error}"
            continue
        if any(
            not np.array_equal(before[k], v, equal_nan=True) for k, v in episode.columns.items()
        ):
            yield f"changes the columns of {name}"
        if value is not None and not isinstance(value, metric.dtype):
            yield f"gives {value!r} over {name}, which is no {metric.dtype.__name__}"
        if value != again:
            yield f"gives {value!r} and then {again!r} over {name}"
        if value != mirrored and not _close(value, mirrored):
            yield f"gives {value!r} over {name} and {mirrored!r} over its mirror image"


check: Contract[type[Metric]] = Contract(it_is_declared, it_keeps_the_conventions, of_classes=True)


def _close(one: float | None, other: float | None) -> bool:
    return one is not None and other is not None and math.isclose(one, other, rel_tol=1e-9)


def _episodes() -> dict[str, Episode]:
    rng = np.random.default_rng(0)
    whole: dict[str, FloatArray] = {name: rng.normal(size=_ROWS) for name in COLUMNS}
    whole |= {"time": _DT * np.arange(_ROWS, dtype=np.float64), "v_x": 10.0 + whole["v_x"]}
    whole |= {name: np.zeros(_ROWS) for name in ("status", "driver", "reason")}
    fine = rng.normal(size=(10 * _ROWS, 2))
    one = {name: values[:1] for name, values in whole.items()}
    none = {name: values[:0] for name, values in whole.items()}
    holed = {name: values.copy() for name, values in whole.items()}
    for name in ("lateral_error", "steer_command", "a_y"):
        holed[name][3] = math.nan
    return {
        "a drive": _episode(whole, fine),
        "a drive that left the road": replace(_episode(whole, fine), end=OFF_TRACK),
        "a drive of one row": _episode(one, fine[:10]),
        "a drive without rows": _episode(none, fine[:0]),
        "a drive with NaN in it": _episode(holed, fine),
    }


def _episode(columns: dict[str, FloatArray], fine: FloatArray) -> Episode:
    return Episode(columns, DURATION, 100.0, _DT, path_length=200.0, closed=True, fine=fine)


def _mirrored(episode: Episode) -> Episode:
    columns = {k: -v if k in LATERAL else v for k, v in episode.columns.items()}
    return replace(episode, columns=columns, fine=episode.fine * np.array([1.0, -1.0]))
