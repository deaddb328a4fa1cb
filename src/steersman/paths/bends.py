"""Bends that a car cannot follow: where, how sharp, and what makes them wider."""

from __future__ import annotations

import math

import numpy as np

from steersman.kernels.path import KAPPA0, LENGTH, S0, SHARPNESS
from steersman.paths.base import PathComponent
from steersman.vehicles import Vehicle


def tightest_turn(vehicle: Vehicle) -> float:
    """Radius on which the centre of mass turns at full lock, slowly [m]."""
    angle = vehicle.wheel_angle(1.0, 0.0)
    return math.hypot(vehicle.wheelbase / math.tan(angle), vehicle.l_r)


def too_sharp(path: PathComponent, vehicle: Vehicle) -> str | None:
    """A sentence about the bends that are sharper than the car can turn; None without any."""
    pieces, length = path.table.pieces, float(path.table.meta[0, LENGTH])
    sizes = np.diff(np.append(pieces[:, S0], length))
    begins = np.abs(pieces[:, KAPPA0])
    ends = np.abs(pieces[:, KAPPA0] + pieces[:, SHARPNESS] * sizes)
    bends = np.maximum(begins, ends)
    least = tightest_turn(vehicle)
    sharp = bends * least > 1.0
    if not sharp.any():
        return None
    worst = int(np.argmax(bends))
    s = float(pieces[worst, S0]) + (float(sizes[worst]) if ends[worst] > begins[worst] else 0.0)
    source = path.whereabouts(s)
    places = int(np.count_nonzero(np.diff(sharp.astype(np.int8), prepend=0) > 0))
    others = f", in {places} places in all" if places > 1 else ""
    return (
        f"it bends with a radius of {1.0 / float(bends[worst]):.2g} m at s = {s:.1f} m"
        f"{source and f' ({source})'}{others}; the car turns no tighter than {least:.1f} m;"
        f" {path.cure()}"
    )
