"""Bends that a car cannot follow: where, how sharp, and what makes them wider."""

from __future__ import annotations

import numpy as np

from steersman.kernels.path import KAPPA0, LENGTH, S0, SHARPNESS
from steersman.paths.base import PathComponent


def too_sharp(path: PathComponent, least: float) -> str | None:
    """A sentence about bends that are sharper than a car's smallest radius; None without any.

    Args:
        path: the road.
        least: radius of the car's tightest turn [m].
    """
    pieces, length = path.table.pieces, float(path.table.meta[0, LENGTH])
    sizes = np.diff(np.append(pieces[:, S0], length))
    begins = np.abs(pieces[:, KAPPA0])
    ends = np.abs(pieces[:, KAPPA0] + pieces[:, SHARPNESS] * sizes)
    bends = np.maximum(begins, ends)
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
