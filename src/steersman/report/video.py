"""A drive as a video in real time: a picture for each control step, fewer in a GIF."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steersman.episode import Episode
from steersman.errors import DataError
from steersman.files import replacing
from steersman.rendering import RenderedStep, RoadRenderer, require, road_line
from steersman.report.html import half_width
from steersman.report.seen import path_of, vehicle_of, waypoints
from steersman.report.signals import ShownDrive

# Between pictures of a GIF, whose format knows hundredths of a second [s].
_BETWEEN = 0.1
_COLUMNS = ("time", "x", "y", "psi", "wheel_angle")
_ERRORS = ("lateral_error", "heading_error", "steer")


def write_video(episode: Episode, file: FilePath) -> None:
    """Write ``.mp4`` or ``.gif``, replacing the file only when complete.

    Raises:
        DataError: the file cannot be written; the episode's road is not known, or it has no steps.
        SteersmanError: the extra ``video`` is not installed.
    """
    require()
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
    every = round(_BETWEEN / episode.dt) or 1 if file.suffix == ".gif" else 1
    pictures = (
        picture.frame(
            RenderedStep._make((*values, np.empty((0, 2)) if seen is None else seen[row]))
        )
        for row, values in enumerate(table)
        if row % every == 0
    )
    with tempfile.TemporaryDirectory() as folder:
        made = FilePath(folder) / f"drive{file.suffix}"
        (_write_gif if file.suffix == ".gif" else _write_mp4)(made, pictures, every * episode.dt)
        with replacing(file) as stream:
            stream.write(made.read_bytes())


def _write_mp4(file: FilePath, pictures: Iterable[NDArray[np.uint8]], between: float) -> None:
    import imageio

    writer: Any
    with imageio.get_writer(file, fps=1.0 / between, codec="libx264") as writer:
        for pixels in pictures:
            writer.append_data(pixels)


def _write_gif(file: FilePath, pictures: Iterable[NDArray[np.uint8]], between: float) -> None:
    """With the palette of the first picture: the others have the same few colours."""
    from PIL import Image

    images = map(Image.fromarray, pictures)
    first = next(images).quantize(dither=Image.Dither.NONE)
    rest = (image.quantize(palette=first, dither=Image.Dither.NONE) for image in images)
    first.save(file, save_all=True, append_images=rest, duration=1e3 * between, loop=0)
