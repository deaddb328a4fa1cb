"""A drive as a video, one picture for each control step, in real time."""

from __future__ import annotations

import tempfile
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.episode import Episode
from steersman.errors import DataError
from steersman.files import replacing
from steersman.rendering import RenderedStep, RoadRenderer, require, road_line
from steersman.report.html import half_width
from steersman.report.seen import path_of, vehicle_of, waypoints
from steersman.report.signals import ShownDrive

_COLUMNS = ("time", "x", "y", "psi", "wheel_angle")
_ERRORS = ("lateral_error", "heading_error", "steer")


def write_video(episode: Episode, file: FilePath) -> None:
    """Write ``.mp4`` or ``.gif``, replacing the file only when complete.

    Raises:
        DataError: the file cannot be written; the episode's road is not known, or it has no steps.
        SteersmanError: the extra ``video`` is not installed.
    """
    require()
    import imageio

    path = path_of(episode)
    if path is None or not len(episode):
        raise DataError(f"{file}: cannot be drawn; the episode has no steps, or its path is gone")
    picture = RoadRenderer(
        road_line(path), half_width([ShownDrive("", episode)]), vehicle_of(episode)[0]
    )
    seen = waypoints(episode, path)
    table = zip(
        *(episode[name].tolist() for name in _COLUMNS),
        np.hypot(episode["v_x"], episode["v_y"]).tolist(),
        *(episode[name].tolist() for name in _ERRORS),
        strict=True,
    )
    with tempfile.TemporaryDirectory() as folder:
        made = FilePath(folder) / f"drive{file.suffix}"
        options: dict[str, Any] = {"fps": 1.0 / episode.dt, "codec": "libx264"}
        if file.suffix == ".gif":
            options = {"duration": 1e3 * episode.dt, "loop": 0}
        writer: Any
        with imageio.get_writer(made, **options) as writer:
            for row, values in enumerate(table):
                points = np.empty((0, 2)) if seen is None else seen[row]
                writer.append_data(picture.frame(RenderedStep._make((*values, points))))
        with replacing(file) as stream:
            stream.write(made.read_bytes())
