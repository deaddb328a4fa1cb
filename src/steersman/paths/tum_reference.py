"""Reference trajectories of TUM-CONTROL (github.com/bzarr/TUM-CONTROL): points with speeds."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from steersman.config import register, required
from steersman.errors import DataError
from steersman.files import read_json
from steersman.paths.point_path import PointPath
from steersman.paths.points import Points

_COLUMNS = ("pos_x", "pos_y", "ref_v")


@register("path", "tum_reference")
class TumReference(PointPath):
    """A cubic spline through the points of such a file; ``speed=path`` drives its speeds.

    Of files by any names ``json`` reads the points.
    """

    file: FilePath = required("-", "JSON file with lists pos_x, pos_y [m] and ref_v [m/s]")

    def recorded(self, *, speeds: bool = False) -> Points:
        """The points of the file.

        Raises:
            DataError: it cannot be read, or has no such lists.
        """
        try:
            data = read_json(self.file)
            x, y, speed = (np.array(data[name], dtype=np.float64) for name in _COLUMNS)
        except DataError:
            raise
        except (ValueError, TypeError, KeyError):
            needs = ", ".join(_COLUMNS)
            raise DataError(f"{self.file}: needs lists of numbers {needs}") from None
        good = x.ndim == 1 and x.shape == y.shape == speed.shape
        if not good or not np.isfinite([x, y, speed]).all() or (speed < 0.0).any():
            raise DataError(f"{self.file}: its lists differ in length, or hold what is no number")
        lines = [*range(1, x.size + 1)]
        return Points(self.file, x, y, lines, self.loop, "point", speed if speeds else None)
