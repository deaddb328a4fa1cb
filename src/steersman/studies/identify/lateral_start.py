"""Where the lateral fit begins: delays and rates are tried all over, a lag is told from none."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from steersman.engine.jobs import Workers
from steersman.engine.work import Job, Tell
from steersman.studies.identify import stretch_replay
from steersman.studies.identify.estimate import Estimate, estimate
from steersman.studies.identify.lateral import measured, misses_of, searched, simulated
from steersman.studies.identify.misses import Selection, scale_of
from steersman.studies.identify.recording import Log
from steersman.studies.identify.stretch_replay import Stretch
from steersman.studies.identify.unknowns import SIGMAS, Sensors, Unknown
from steersman.studies.identify.valleys import (
    RATES,
    delay_of,
    explained,
    whole_delay,
    with_lag_or_without,
)
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# Delays [s] and factors on the steering rates from which the search may start.
_DELAYS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
_CLOCKS = (-0.2, -0.1, 0.0, 0.1, 0.2)
_RATES = (1.0, 0.25, 0.5, 2.0, 4.0)
# Another start has to leave this share less of the residuals' variance.
_BETTER = 0.02
# Length of a recording [s] from which two starts are worth a process each.
_LONG = 60.0
# Delays are tried on so much of a longer one [s], lags and rates are decided on so much, in blocks
# of this length [s].
_FEW, _ENOUGH, _BLOCK = 20.0, 60.0, 10.0


class _Start(NamedTuple):
    """Where a search starts, and where unknowns stand that it does not determine: z (p,)."""

    z: FloatArray
    rest: FloatArray


def begun(
    vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], use: Any, workers: Workers
) -> tuple[Estimate, FloatArray]:
    """The estimate of the part that tells most, and where unknowns stand that it does not tell."""
    few = telling(vehicle, log, stretches, use, _FEW)
    stretches = telling(vehicle, log, stretches, use, _ENOUGH)
    unknowns = searched(vehicle, log)
    starts = [_start(vehicle, log, few, unknowns, use, (1.0,) if log.by_angle else _RATES)]
    if starts[0].rest.any():  # slow rates may be a lag, which starts are looked for without
        starts.append(_start(vehicle, log, few, unknowns, use, (1.0,)))
    work = partial(_from_start, vehicle, log, few, stretches, use)
    jobs = [Job(str(k), start, float(log.time[-1])) for k, start in enumerate(starts)]
    with workers as several:
        found, *others = several.run(work, jobs, piece_size=_LONG).values()
    misses, rest = misses_of(vehicle, log, stretches, unknowns, use), starts[0].rest
    for trial in others:
        if explained(misses, found, trial) <= len(RATES) * 0.5 * SIGMAS**2:
            found, rest = trial, starts[1].rest
    return found, rest


def telling(
    vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], use: Any, enough: float
) -> Sequence[Stretch]:
    """Of a recording of more than twice ``enough`` [s] the blocks with the most steering."""
    blocks: list[tuple[float, Stretch]] = []
    for stretch in stretches:
        edges = np.arange(stretch.time[0], stretch.time[-1], _BLOCK)
        cuts = [*np.searchsorted(stretch.time, edges).tolist(), len(stretch.time)]
        for a, b in pairwise(cuts):
            rows = slice(stretch.rows.start + a, stretch.rows.start + b)
            good = stretch.steady[a:b] & use[rows]
            if b - a > 1 and good.mean() > 0.5:  # noqa: PLR2004 - most of it
                quick = np.diff(log.signals["steer_command"][rows]) * log.signals["v_x"][rows][1:]
                part = stretch_replay.of_rows(log, rows, vehicle).without(
                    stretch.left_out.upset[a:b]
                )
                blocks.append((float(np.nansum(quick**2)), part))
    if len(blocks) * _BLOCK < 2.0 * enough:
        return stretches
    blocks.sort(key=lambda block: -block[0])
    return [part for _, part in blocks[: round(enough / _BLOCK)]]


def _from_start(
    vehicle: Vehicle,
    log: Log,
    few: Sequence[Stretch],
    stretches: Sequence[Stretch],
    use: Any,
    start: _Start,
    tell: Tell,
) -> Estimate:
    """The estimate that is found from a start, with or without a lag; the delay from a ``few``."""
    unknowns = searched(vehicle, log)
    misses = misses_of(vehicle, log, stretches, unknowns, use)
    how, z = Selection.of(misses, start.rest), start.z
    step = stretch_replay.H / unknowns[delay_of(misses.names)].prior
    lag = None if log.by_angle else misses.names.index("steer_lag")
    if lag is not None and unknowns[lag].start > 0.0:
        return estimate(misses, z, how)
    first = how if lag is None else how.without(lag)
    begun = whole_delay(misses_of(vehicle, log, few, unknowns, use), z, first, step)
    if lag is None:
        return estimate(misses, begun, how)
    return with_lag_or_without(misses, begun, float(z[lag]), how, step)


def _start(
    vehicle: Vehicle,
    log: Log,
    stretches: Sequence[Stretch],
    unknowns: Sequence[Unknown],
    use: Any,
    factors: Sequence[float],
) -> _Start:
    """The best of some delays and rates, and the ratio there.

    For each the measured yaw rate is regressed on the simulated one, outliers left out.
    """
    names = [u.name for u in unknowns]
    seen = measured(log, stretches, use)[:, 0]
    best, chosen = np.inf, (0.0, 1.0, 1.0)
    plain, delays = Sensors({}, {}, 0.0, log.yaw_rate_lag), _CLOCKS if log.by_angle else _DELAYS
    for factor in factors:
        rates = {name: getattr(vehicle, name) * factor for name in RATES}
        for delay in sorted({*delays, vehicle.steer_delay}):
            guess = vehicle.replace(steer_delay=0.0 if log.by_angle else delay, **rates)
            late = delay if log.by_angle else 0.0
            answer = simulated(guess, log, stretches, plain._replace(clock=late))[:, 0]
            gain, left = _regressed(answer, seen)
            if left < (1.0 - _BETTER) * best:
                best, chosen = left, (delay, factor, gain)
    delay, factor, gain = chosen
    z, rest = np.zeros(len(unknowns)), np.zeros(len(unknowns))
    for name, value in (
        (names[delay_of(names)], delay),
        ("max_wheel_angle", vehicle.max_wheel_angle * min(max(gain, 0.25), 4.0)),
        *((name, getattr(vehicle, name) * factor) for name in RATES if name in names),
    ):
        i = names.index(name)
        z[i] = np.clip(unknowns[i].z(value), *unknowns[i].bounds())
        if name in RATES:
            rest[i] = z[i]
    return _Start(z, rest)


def _regressed(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope of y on x and the robust scale of what is left."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 3 or float(np.ptp(x)) == 0.0:  # noqa: PLR2004 - a line and one more
        return 1.0, float(scale_of((y - np.mean(y))[:, None])[0]) if len(y) else 1.0
    gain, shift = 1.0, 0.0
    keep = np.full(len(x), True)
    for _ in range(3):
        gain, shift = np.polyfit(x[keep], y[keep], 1)
        left = np.abs(y - gain * x - shift)
        keep = left <= max(4.0 * 1.4826 * float(np.median(left)), 1e-12)
    return float(gain), float(np.sqrt(np.mean(left[keep] ** 2)))
