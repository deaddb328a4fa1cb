"""Drawings of what the symbols mean: the single track, the errors, the look-ahead, Stanley."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from html import escape

Point = tuple[float, float]
WIDTH, MARGIN = 640, 16
# A letter behind _ in words stands lower and smaller; what follows, as before.
LOWER = re.compile(r"_(\w)")
INDEX = r'<tspan dy="4" font-size="11">\1</tspan><tspan dy="-4">&#8203;</tspan>'
# Pages make the grey of attributes the colour of their text (docs/hooks). A style holds for all of
# the page that a figure becomes a part of, therefore the class.
STYLE = """
.drawing text { font: 15px sans-serif; stroke: none; }
.drawing path { fill: none; stroke-width: 1.6; } .drawing circle { stroke: none; }
.drawing .road { stroke: #a0a0a0; stroke-width: 2.4; } .drawing .thin { stroke-width: 1; }
.drawing .dash { stroke-width: 1; stroke-dasharray: 5 4; } .drawing .wheel { stroke-width: 8; }
.drawing path.main { stroke: #2b86d9; stroke-width: 2.4; } .drawing text.main { fill: #2b86d9; }
"""


class Drawing:
    """Shapes in metres, x to the right and y upwards."""

    def __init__(self, title: str, scale: float, origin: Point) -> None:
        """``scale`` in pixels for a metre; ``origin`` is where (0, 0) is [pixels]."""
        self._scale, self._origin = scale, origin
        self._parts = [f"<title>{escape(title)}</title><style>{STYLE}</style>"]
        self._heights: list[float] = []

    def _at(self, p: Point) -> str:
        x, y = self._origin
        self._heights.append(y - self._scale * p[1])
        return f"{x + self._scale * p[0]:.1f} {y - self._scale * p[1]:.1f}"

    def line(self, points: Sequence[Point], kind: str = "") -> None:
        """A line through points."""
        path = " L".join(self._at(p) for p in points)
        self._parts.append(f'<path class="{kind}" d="M{path}"/>')

    def arrow(self, a: Point, b: Point, kind: str = "") -> None:
        """A line with a head at ``b``."""
        turn, size = math.atan2(b[1] - a[1], b[0] - a[0]), 10.0 / self._scale
        head = [along(b, turn + side, -size) for side in (0.4, -0.4)]
        self.line([a, b], kind)
        self.line([head[0], b, head[1]], kind)

    def arc(self, middle: Point, radius: float, begin: float, end: float, kind: str = "") -> None:
        """Part of a circle between two angles [rad]."""
        angles = [begin + (end - begin) * k / 40 for k in range(41)]
        self.line([along(middle, angle, radius) for angle in angles], kind)

    def text(self, p: Point, words: str, kind: str = "") -> None:
        """Words around a point; a letter behind _ is an index."""
        x, y = self._at(p).split()
        middle = 'text-anchor="middle" dominant-baseline="middle"'
        shown = LOWER.sub(INDEX, escape(words))
        self._parts.append(f'<text class="{kind}" x="{x}" y="{y}" {middle}>{shown}</text>')

    def dot(self, p: Point) -> None:
        """A point."""
        x, y = self._at(p).split()
        self._parts.append(f'<circle cx="{x}" cy="{y}" r="4"/>')

    def svg(self) -> str:
        """The drawing."""
        top, bottom = min(self._heights) - MARGIN, max(self._heights) + MARGIN
        size = f"0 {top:.1f} {WIDTH} {bottom - top:.1f}"
        box = f'viewBox="{size}" role="img" fill="#808080" stroke="#808080"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" {box}>'
        return "\n".join([head, *self._parts, "</svg>", ""])


def along(p: Point, angle: float, distance: float) -> Point:
    """The point so far from ``p`` at an angle."""
    return p[0] + distance * math.cos(angle), p[1] + distance * math.sin(angle)


def car(
    d: Drawing, middle: Point, psi: float, delta: float, half: float = 1.4
) -> tuple[Point, Point]:
    """A single track, and where its front and rear wheels are."""
    front, rear = along(middle, psi, half), along(middle, psi, -half)
    d.line([rear, front])
    for wheel, turn in ((front, psi + delta), (rear, psi)):
        d.line([along(wheel, turn, -0.36), along(wheel, turn, 0.36)], "wheel")
    d.dot(middle)
    return front, rear


def single_track() -> str:
    """Angles, lengths and forces of the single track."""
    d, psi, delta, beta = Drawing("Single-track model", 70.0, (250.0, 190.0)), 0.3, 0.4, 0.16
    front, rear = car(d, (0.0, 0.0), psi, delta, 2.0)
    d.arrow((0.0, 0.0), (2.9, 0.0), "dash")
    d.text((3.05, 0.0), "x")
    d.arc((0.0, 0.0), 1.35, 0.0, psi, "thin")
    d.text(along((0.0, 0.0), 0.5 * psi, 1.55), "ψ")
    d.arrow((0.0, 0.0), along((0.0, 0.0), psi + beta, 1.5), "main")
    d.text(along((0.0, 0.0), psi + beta + 0.08, 1.7), "v", "main")
    d.arc((0.0, 0.0), 1.05, psi, psi + beta, "thin")
    d.text(along((0.0, 0.0), psi + 0.5 * beta, 0.86), "β")
    d.line([front, along(front, psi, 1.5)], "dash")
    d.line([front, along(front, psi + delta, 1.5)], "dash")
    d.arc(front, 1.1, psi, psi + delta, "thin")
    d.text(along(front, psi + 0.5 * delta, 1.3), "δ")
    for wheel, turn, name in ((front, psi + delta, "F_f"), (rear, psi, "F_r")):
        d.arrow(wheel, along(wheel, turn + 0.5 * math.pi, 1.1), "main")
        d.text(along(wheel, turn + 0.5 * math.pi, 1.3), name, "main")
    down = psi - 0.5 * math.pi
    for a, b, name in (((0.0, 0.0), front, "l_f"), (rear, (0.0, 0.0), "l_r")):
        low = [along(p, down, 0.55) for p in (a, b)]
        d.arrow(low[0], low[1], "thin")
        d.arrow(low[1], low[0], "thin")
        middle = (0.5 * (low[0][0] + low[1][0]), 0.5 * (low[0][1] + low[1][1]))
        d.text(along(middle, down, 0.22), name)
    d.arc((0.0, 0.0), 0.5, psi + 1.9, psi + 4.2, "main")
    d.text(along((0.0, 0.0), psi + 2.6, 0.75), "r", "main")
    return d.svg()


def errors() -> str:
    """Lateral, heading and course error at the nearest point of the road, and the waypoints."""
    d, radius, half = Drawing("Errors and waypoints", 62.0, (130.0, 250.0)), 9.0, 1.2
    middle, nearest, road = (0.0, radius), (0.0, 0.0), 0.0
    d.arc(middle, radius, -0.5 * math.pi - 0.22, -0.5 * math.pi + 0.95, "road")
    psi, d_left, beta = road + 0.32, 1.5, 0.14
    place = along(nearest, road + 0.5 * math.pi, d_left)
    car(d, place, psi, 0.0, half)
    d.dot(nearest)
    d.line([nearest, (3.6, 0.0)], "dash")
    d.text((3.9, -0.16), "tangent")
    d.arrow(nearest, place, "main")
    d.text((-0.25, 0.55), "d", "main")
    d.line([place, along(place, road, 3.0)], "dash")
    d.line([place, along(place, psi, 2.9)], "dash")
    d.arc(place, 2.5, road, psi, "thin")
    d.text(along(place, road + 0.45 * psi, 2.75), "e₂")
    d.arrow(place, along(place, psi + beta, 1.9), "main")
    d.text(along(place, psi + beta + 0.06, 2.15), "v", "main")
    d.arc(place, 1.6, road, psi + beta, "thin")
    d.text(along(place, road - 0.12, 1.6), "Φ")
    for k in range(1, 6):
        d.dot(along(middle, -0.5 * math.pi + 0.16 * k, radius))
    d.text(along(middle, -0.5 * math.pi + 0.74, radius + 0.7), "waypoints")
    d.text((-0.5, -0.3), "s")
    return d.svg()


def look_ahead() -> str:
    """The circle through the rear axle that meets the road at the look-ahead distance."""
    d, distance, angle = Drawing("Look-ahead of pure pursuit", 72.0, (110.0, 230.0)), 5.2, 0.42
    rear, base = (0.0, 0.0), 2.6
    radius = distance / (2.0 * math.sin(angle))
    car(d, (0.5 * base, 0.0), 0.0, math.atan(base / radius), 0.5 * base)
    goal = along(rear, angle, distance)
    d.arc((0.0, radius), radius, -0.5 * math.pi, -0.5 * math.pi + 2.0 * angle, "main")
    d.line([(0.0, 1.5), (1.6, 1.72), (3.2, 1.95), goal, (6.6, 2.5)], "road")
    d.line([rear, goal], "dash")
    d.text(along(rear, angle + 0.1, 0.5 * distance), "look-ahead")
    d.dot(goal)
    d.text((goal[0], goal[1] + 0.32), "(x_a, y_a)")
    d.line([rear, (goal[0], 0.0)], "dash")
    d.arrow((goal[0], 0.0), goal, "thin")
    d.text((goal[0] + 0.3, 0.5 * goal[1]), "y_a")
    d.text((3.95, 0.55), "curvature κ_c", "main")
    d.text((0.5 * base, -0.4), "wheelbase L")
    d.text((6.3, 2.2), "road")
    return d.svg()


def stanley_errors() -> str:
    """Stanley's errors are those of the front axle."""
    d, psi, left = Drawing("Errors of the front axle", 74.0, (130.0, 250.0)), 0.38, 1.5
    d.line([(-1.4, 0.0), (6.0, 0.0)], "road")
    middle = (2.0 - 1.4 * math.cos(psi), left - 1.4 * math.sin(psi))
    delta = -psi - 0.35
    front, _ = car(d, middle, psi, delta)
    d.arrow((front[0], 0.0), front, "main")
    d.dot((front[0], 0.0))
    d.text((front[0] - 0.28, 0.6), "e_f", "main")
    d.line([front, along(front, 0.0, 2.4)], "dash")
    d.line([front, along(front, psi, 1.9)], "dash")
    d.arc(front, 1.35, 0.0, psi, "thin")
    d.text(along(front, 0.5 * psi, 1.6), "ψ_f")
    d.line([front, along(front, psi + delta, 2.4)], "main")
    d.arc(front, 1.9, psi + delta, 0.0, "thin")
    d.text(along(front, 0.5 * (psi + delta), 3.2), "arctan(k e_f / (k_s + v))")
    d.text((5.4, -0.25), "road")
    return d.svg()


FIGURES: dict[str, Callable[[], str]] = {
    "single_track": single_track,
    "errors": errors,
    "look_ahead": look_ahead,
    "stanley_errors": stanley_errors,
}
