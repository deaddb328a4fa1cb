"""Paths from recordings in CSV files: the line that a car drove, and its speeds there."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from steersman.config import param, register, required
from steersman.errors import ConfigError, DataError
from steersman.logs.columns import check_time, missing, read_columns
from steersman.paths.point_path import RecordedPath
from steersman.paths.points import Points, has_positions
from steersman.tables import Sheet
from steersman.types import FloatArray

_NEEDED = ("time", "x", "y")


@register("path", "log")
class LogPath(RecordedPath):
    """The driven line of a recording in a CSV file, with the speeds at which it was driven.

    A cubic spline goes through its positions, as for csv; ``speed=path`` drives the recorded speed.
    """

    file: FilePath = required("-", "CSV file with time and position")
    columns: str | None = param(
        None,
        "-",
        "where they stand: time=t,x=pos_x,y=pos_y,v_x_km_h=v, or carla; null: by their names",
    )
    spacing: float = param(
        2.0, "m", "points closer to the last one than this are left out", ge=0.1, le=50.0
    )

    def recorded(self, *, speeds: bool = False) -> Points:
        """The positions of the recording.

        Raises:
            DataError: they cannot be used; one line says where and what to do.
        """
        try:
            sheet, signals = read_columns(self.file, self.columns)
        except ConfigError as error:
            raise ConfigError(error.what, ("columns",)) from None
        for name in _NEEDED:
            if name not in signals:
                raise sheet.fault(sheet.title_line, missing(name, sheet.titles) + _instead(sheet))
        time = signals["time"]
        check_time(sheet, time)
        time = time - time[0]
        known = np.isfinite(signals["x"]) & np.isfinite(signals["y"])
        if self.window is not None:
            known &= (time >= self.window[0]) & (time <= self.window[1])
        rows = np.flatnonzero(known)
        if not rows.size:
            raise DataError(f"{self.file}: no position in window; the last is at {time[-1]:.3f} s")
        x, y = signals["x"][rows], signals["y"][rows]
        lines = [sheet.lines[row] for row in rows.tolist()]
        # A line that ends near its start may just stop there; where it passes it, it is a lap.
        return Points(self.file, x, y, lines, False, speed=_speed(signals, time, rows))


def _instead(sheet: Sheet) -> str:
    """The end of a message about a table that has other positions than x and y."""
    if not has_positions(sheet):
        return ""
    return "; latitude and longitude are for path=csv, with speed=path at the recorded speed"


def _speed(signals: dict[str, FloatArray], time: FloatArray, rows: NDArray[np.int64]) -> FloatArray:
    """Recorded at those rows [m/s], or if it was not, the change of position over time."""
    for name in ("speed", "v_x"):
        values = signals.get(name)
        if values is not None and np.isfinite(values[rows]).any():
            good = np.isfinite(values)
            return np.asarray(np.maximum(np.interp(time[rows], time[good], values[good]), 0.0))
    if rows.size == 1:
        return np.zeros(1)
    east, north = (np.gradient(signals[name][rows], time[rows]) for name in ("x", "y"))
    return np.asarray(np.hypot(east, north))
