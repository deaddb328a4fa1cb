"""Two drives on the same path, compared at the same places of it.

Values are interpolated to even steps of arc length over the stretch that both drove, so that a
faster drive counts no less than a slower one. Neighbouring places are alike: the bootstrap draws
blocks (:class:`steersman.bench.statistics.Blocks`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from steersman.bench.pairs import Contrast, Quantity, contrast
from steersman.bench.statistics import Blocks, block_length
from steersman.episode import Episode
from steersman.stored import StoredResult
from steersman.types import FloatArray

# Distance between places that are compared [m].
STEP = 1.0
# Runs are on the same path if their points at the same arc length are closer than this [m].
SAME_PATH = 0.5
# With fewer places nothing is compared.
LEAST = 20


def _absolute(column: str, scale: float = 1.0) -> Callable[[Episode], FloatArray]:
    return lambda episode: scale * np.abs(episode[column])


def _rate(column: str) -> Callable[[Episode], FloatArray]:
    """Differences per second, each at the row where it begins."""

    def values(episode: Episode) -> FloatArray:
        signal = episode[column]
        return np.diff(signal, append=signal[-1:]) / episode.dt

    return values


def _speed(episode: Episode) -> FloatArray:
    return np.hypot(episode["v_x"], episode["v_y"])


_DEG = 180.0 / math.pi
ALONG: dict[str, Quantity] = {
    "mean_abs_lateral_error_m": Quantity("mean |d|", "mm", 1e3, _absolute("lateral_error")),
    "rms_lateral_error_m": Quantity("RMS error", "mm", 1e3, _absolute("lateral_error"), True),
    "mean_abs_heading_error_deg": Quantity(
        "|heading error|", "deg", 1.0, _absolute("heading_error", _DEG)
    ),
    "mean_abs_course_error_deg": Quantity(
        "|course error|", "deg", 1.0, _absolute("course_error", _DEG)
    ),
    "steer_rate_rms_per_s": Quantity("RMS steering rate", "1/s", 1.0, _rate("steer_command"), True),
    "lateral_jerk_rms_m_s3": Quantity("RMS lateral jerk", "m/s³", 1.0, _rate("a_y"), True),
    "mean_speed_m_s": Quantity("mean speed", "m/s", 1.0, _speed),
}


def distance(episode: Episode) -> FloatArray:
    """Arc length along the path, counted on over the laps of a loop [m]."""
    s = episode["s"]
    return np.unwrap(s, period=episode.path_length) if episode.closed and s.size else s


def same_path(a: Episode, b: Episode) -> bool:
    """Whether two runs followed the same path: same length, same points at the same s."""
    if a.closed != b.closed or not np.isclose(a.path_length, b.path_length, rtol=1e-6, atol=1e-3):
        return False
    if not len(a) or not len(b):
        return True
    s_a, s_b = a["s"], b["s"]
    if a.closed:
        s_a, s_b = s_a % a.path_length, s_b % b.path_length
    common = (s_a >= s_b.min()) & (s_a <= s_b.max())
    if not common.any():
        return True
    order = np.argsort(s_b)
    gaps = [
        np.interp(s_a[common], s_b[order], b[name][order]) - a[name][common]
        for name in ("path_x", "path_y")
    ]
    return float(np.median(np.hypot(*gaps))) < SAME_PATH


class AlongComparison(StoredResult):
    """A drive against another at the same places of their path."""

    from_m: float
    to_m: float
    """The stretch that both drove, as arc length."""
    places: int
    """Places that are compared, ``STEP`` apart."""
    block_m: float
    """Length of the bootstrap's blocks."""
    blocks: int
    """Blocks that the stretch holds."""
    figures: dict[str, Contrast]
    """By name of ``ALONG``."""


def along_path(base: Episode, own: Episode) -> AlongComparison | None:
    """A drive against another on the same path; None if they have too little of it in common."""
    if not len(base) or not len(own):
        return None
    places = [np.maximum.accumulate(distance(episode)) for episode in (base, own)]
    if base.closed:  # the same place may stand as 0 or as a whole lap
        lap = base.path_length
        places[1] = places[1] + lap * round((places[0][0] - places[1][0]) / lap)
    first, last = max(p[0] for p in places), min(p[-1] for p in places)
    count = math.floor((last - first) / STEP + 1e-9) + 1
    if count < LEAST:
        return None
    grid = first + STEP * np.arange(count)
    values = {
        name: [
            np.interp(grid, p, figure.value(e)) for p, e in zip(places, (base, own), strict=True)
        ]
        for name, figure in ALONG.items()
    }
    length = _block(values)
    draws = Blocks(count, length)
    return AlongComparison(
        from_m=first,
        to_m=last,
        places=count,
        block_m=length * STEP,
        blocks=count // length,
        figures={name: contrast(draws, ALONG[name], *pair) for name, pair in values.items()},
    )


def _block(values: Mapping[str, list[FloatArray]]) -> int:
    """The longest block that any of the figures needs, in places."""
    lengths = []
    for name, (one, other) in values.items():
        a, b = (np.square(v) if ALONG[name].squared else v for v in (one, other))
        lengths.append(block_length(b - a))
    return math.ceil(max(lengths))
