"""Pictures of a car on its road, drawn with pygame: frames of videos, and a window."""

from __future__ import annotations

import os
import warnings
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.errors import SteersmanError, how_to_install
from steersman.paths.base import PathComponent
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

SIZE = (640, 400)
"""Of a picture: width and height [pixels]."""
_SCALE = 9.0  # pixels per metre
# Distance between points of a road, and how many there are at most [m].
_STEP, _MOST = 0.5, 20_000
_WHEEL = (0.70, 0.22)  # length and width of a wheel [m]
_TRAIL = 400  # points of the driven line
_GROUND, _ROAD, _EDGE, _PATH = (232, 238, 232), (252, 252, 252), (110, 118, 128), (150, 158, 166)
_CAR, _TYRE, _SEEN, _INK = (0, 114, 178), (30, 34, 40), (213, 94, 0), (28, 33, 38)


class RoadLine(NamedTuple):
    """The line to follow."""

    x: FloatArray
    y: FloatArray


def road_line(path: PathComponent) -> RoadLine:
    """Points of the whole path [m]."""
    count = int(np.clip(np.ceil(path.length / _STEP), 2, _MOST))
    points = [path.at(s) for s in np.linspace(0.0, path.length, count + 1)]
    return RoadLine(np.array([p.x for p in points]), np.array([p.y for p in points]))


class RenderedStep(NamedTuple):
    """What a picture shows of a control step."""

    time: float
    """[s]"""
    x: float
    """Centre of mass [m]."""
    y: float
    psi: float
    """Yaw [rad]."""
    wheel_angle: float
    """[rad]"""
    speed: float
    """[m/s]"""
    lateral_error: float
    """[m]"""
    heading_error: float
    """[rad]"""
    steer: float
    """Normalised steering [-]."""
    waypoints: FloatArray
    """As the controller sees them, (n, 2), in the vehicle's frame [m]."""


def require() -> None:
    """Check before a drive that its pictures can be drawn and written.

    Raises:
        SteersmanError: the extra ``video`` is not installed.
    """
    if find_spec("imageio") is None or find_spec("pygame") is None:
        raise SteersmanError(f"a video needs {how_to_install('video')}")


def _pygame() -> Any:
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the libraries that it uses
            import pygame
    except ModuleNotFoundError:
        raise SteersmanError(f"rendering needs {how_to_install('video')}") from None
    return pygame


class RoadRenderer:
    """Draws steps of a drive, from above, north up, the car in the middle."""

    def __init__(self, road: RoadLine, half_width: float, vehicle: Vehicle) -> None:
        """Prepare for a road [m], the corridor's half width [m] and a vehicle.

        Raises:
            SteersmanError: the extra ``video`` is not installed.
        """
        self._game = _pygame()
        self._game.font.init()
        self._font = self._game.font.Font(None, 22)
        self._surface = self._game.Surface(SIZE)
        self._vehicle = vehicle
        line = np.stack(road, axis=1)
        tangent = np.gradient(line, axis=0)
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
        normal = half_width * np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        self._line, self._sides = line, (line + normal, line - normal, line)
        self._trail: list[tuple[float, float]] = []
        self._window: Any = None
        self._clock: Any = None

    def restart(self) -> None:
        """Forget the driven line."""
        self._trail.clear()

    def frame(self, step: RenderedStep) -> NDArray[np.uint8]:
        """The picture of a step, (height, width, 3)."""
        self._draw(step)
        pixels: NDArray[np.uint8] = self._game.surfarray.array3d(self._surface)
        return np.ascontiguousarray(pixels.transpose(1, 0, 2))

    def show(self, step: RenderedStep, fps: float) -> None:
        """Show a step in a window, no sooner than 1 / fps [s] after the last one."""
        game = self._game
        if self._window is None:
            game.display.init()
            game.display.set_caption("Steersman")
            self._window, self._clock = game.display.set_mode(SIZE), game.time.Clock()
        self._draw(step)
        self._window.blit(self._surface, (0, 0))
        game.event.pump()
        game.display.flip()
        self._clock.tick(fps)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._game.display.quit()
            self._window = None

    def _draw(self, step: RenderedStep) -> None:
        draw, surface, width, height = self._game.draw, self._surface, *SIZE
        middle = np.array([step.x, step.y])

        def place(points: FloatArray) -> list[tuple[float, float]]:
            """Pixels of points (n, 2) [m]."""
            moved = (points - middle) * _SCALE
            return list(zip(width / 2 + moved[:, 0], height / 2 - moved[:, 1], strict=True))

        surface.fill(_GROUND)
        near = np.flatnonzero(np.abs(self._line - middle).max(axis=1) < width / _SCALE)
        parts = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)
        sides = [[place(side[part]) for side in self._sides] for part in parts if part.size > 1]
        for left, right, _ in sides:
            draw.polygon(surface, _ROAD, [*left, *right[::-1]])
        for left, right, path in sides:
            for side in (left, right):
                draw.lines(surface, _EDGE, False, side, 2)
            for k in range(0, len(path) - 2, 4):
                draw.lines(surface, _PATH, False, path[k : k + 3])
        self._trail = [*self._trail[1 - _TRAIL :], (step.x, step.y)]
        if len(self._trail) > 1:
            draw.lines(surface, _CAR, False, place(np.array(self._trail)), 2)
        turn = _rotation(step.psi)
        for point in place(middle + step.waypoints @ turn.T):
            draw.circle(surface, _SEEN, point, 4, 2)
        for shape, color in self._car(step.wheel_angle):
            draw.polygon(surface, color, place(middle + shape @ turn.T))
        self._write(step)

    def _car(self, angle: float) -> list[tuple[FloatArray, tuple[int, int, int]]]:
        """Polygons in the vehicle's frame [m], wheels below the body."""
        car = self._vehicle
        wheels = [
            (_box(*_WHEEL) @ _rotation(a).T + [along, side * car.track_width / 2], _TYRE)
            for along, a in ((car.l_f, angle), (-car.l_r, 0.0))
            for side in (-1, 1)
        ]
        body = _box(car.body_length, car.width) + np.array([(car.l_f - car.l_r) / 2, 0.0])
        return [(body, _CAR), *wheels]

    def _write(self, step: RenderedStep) -> None:
        texts = (
            f"{step.time:.1f} s   {step.speed:.1f} m/s   steering {step.steer:+.3f}",
            f"lateral error {1e3 * step.lateral_error:+.1f} mm   "
            f"heading error {np.degrees(step.heading_error):+.2f} deg",
        )
        for row, text in enumerate(texts):
            self._surface.blit(self._font.render(text, True, _INK), (10, 8 + 20 * row))


def _rotation(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _box(length: float, width: float) -> FloatArray:
    return np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [length / 2, width / 2]
