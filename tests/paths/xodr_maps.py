"""Small OpenDRIVE maps of our own, made by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath

from steersman.paths.segments import Segment, end_pose
from steersman.types import Pose

WIDTH = 3.5
RADIUS = 12.0


def lane(number: int, widths: str = "", links: str = "", kind: str = "driving") -> str:
    """A lane; without widths it is 3.5 m wide."""
    widths = widths or cubic("width", "sOffset", 0.0, WIDTH)
    return f'<lane id="{number}" type="{kind}"><link>{links}</link>{widths}</lane>'


def cubic(
    tag: str, where: str, s: float, a: float, b: float = 0, c: float = 0, d: float = 0
) -> str:
    """A polynomial record."""
    return f'<{tag} {where}="{s}" a="{a}" b="{b}" c="{c}" d="{d}"/>'


def goes_on(number: int) -> str:
    """Links of a lane to lanes of the same number on both sides."""
    return f'<predecessor id="{number}"/><successor id="{number}"/>'


def section(s: float = 0.0, left: str = "", right: str = "", extra: str = "") -> str:
    """A lane section."""
    sides = "".join(
        f"<{name}>{lanes}</{name}>" for name, lanes in (("left", left), ("right", right)) if lanes
    )
    middle = '<center><lane id="0" type="none"/></center>'
    return f'<laneSection s="{s}" {extra}>{middle}{sides}</laneSection>'


TWO_WAYS = section(0.0, lane(1, links=goes_on(1)), lane(-1, links=goes_on(-1)))
ONE_WAY = section(0.0, "", lane(-1, links=goes_on(-1)))


def geometry(s: float, start: Pose, length: float, shape: str) -> str:
    """A geometry of any shape."""
    x, y, psi = start
    return f'<geometry s="{s}" x="{x}" y="{y}" hdg="{psi}" length="{length}">{shape}</geometry>'


def plan(segments: Sequence[Segment], start: Pose) -> tuple[str, float, Pose]:
    """Lines, arcs and spirals; their length; and where they end."""
    out, s = [], 0.0
    for segment in segments:
        length, low, high, _ = segment
        if low != high:
            shape = f'<spiral curvStart="{low}" curvEnd="{high}"/>'
        else:
            shape = f'<arc curvature="{low}"/>' if low else "<line/>"
        out.append(geometry(s, start, length, shape))
        s, start = s + length, end_pose([segment], start)
    return "".join(out), s, start


def road(
    number: str,
    view: str,
    length: float,
    lanes: str = TWO_WAYS,
    links: str = "",
    offset: str = "",
    more: str = "",
) -> str:
    """A road."""
    return (
        f'<road id="{number}" length="{length}" {more}><link>{links}</link>'
        f"<planView>{view}</planView><lanes>{offset}{lanes}</lanes></road>\n"
    )


def to(side: str, kind: str, number: str, contact: str = "") -> str:
    """A road's link at one of its ends."""
    contact = f'contactPoint="{contact}"' if contact else ""
    return f'<{side} elementType="{kind}" elementId="{number}" {contact}/>'


def whole(*parts: str, attributes: str = "") -> str:
    """A file."""
    return f'<?xml version="1.0"?>\n<OpenDRIVE {attributes}>\n{"".join(parts)}</OpenDRIVE>\n'


def single(
    view: str, length: float, lanes: str = TWO_WAYS, offset: str = "", more: str = ""
) -> str:
    """A file with the one road "1"."""
    return whole(road("1", view, length, lanes, offset=offset, more=more))


def write(file: FilePath, text: str) -> FilePath:
    """A file with this text."""
    file.write_text(text, encoding="utf-8")
    return file


def wavy() -> str:
    """One road whose lanes bend without a jump: spirals, and a width that fades in and out."""
    bends = [
        *(Segment(30.0, 0.0, 0.0), Segment(20.0, 0.0, 0.03), Segment(25.0, 0.03, 0.03)),
        *(Segment(35.0, 0.03, -0.02), Segment(20.0, -0.02, 0.0), Segment(20.0, 0.0, 0.0)),
    ]
    view, length, _ = plan(bends, Pose(10.0, -5.0, 0.4))
    return single(view, length, ONE_WAY)


def town() -> str:
    """Four roads around a junction, one of them the way back.

    "a" is 60 m from the origin along +x to the junction "j". From there "a-left", "a-on" and
    "a-right" lead to "left", "on" and "right", 40 m each. "right" goes on to "back", which is
    laid against its driving direction and leads around to "a": a lap to the right.
    """
    turn = math.pi / 2.0 * RADIUS
    short, bend = Segment(3.0, 0.0, 0.0), Segment(turn, 1 / RADIUS, 1 / RADIUS)
    left = [short, bend, short]
    right = [Segment(s.length, -s.kappa_start, -s.kappa_end) for s in left]
    ways = {"left": left, "on": [Segment(20.0, 0.0, 0.0)], "right": right}
    view, length, middle = plan([Segment(60.0, 0.0, 0.0)], Pose(0.0, 0.0, 0.0))
    links = to("predecessor", "road", "back", "start") + to("successor", "junction", "j")
    roads = [road("a", view, length, links=links)]
    connections = []
    for name, segments in ways.items():
        view, length, end = plan(segments, middle)
        links = to("predecessor", "road", "a", "end") + to("successor", "road", name, "start")
        roads.append(road(f"a-{name}", view, length, ONE_WAY, links, more='junction="j"'))
        connections.append(
            f'<connection id="{name}" incomingRoad="a" connectingRoad="a-{name}"'
            f' contactPoint="start"><laneLink from="-1" to="-1"/></connection>'
        )
        view, length, _ = plan([Segment(40.0, 0.0, 0.0)], end)
        links, lanes = to("predecessor", "junction", "j"), TWO_WAYS
        if name == "right":
            links += to("successor", "road", "back", "end")
            lanes = section(0.0, "", lane(-1, links='<successor id="1"/>'))
        roads.append(road(name, view, length, lanes, links))
    # Laid from where "a" begins, backwards.
    laid = [bend, Segment(43.0, 0.0, 0.0), bend, Segment(63.0, 0.0, 0.0), bend]
    view, length, _ = plan(laid, Pose(0.0, 0.0, math.pi))
    links = to("predecessor", "road", "a", "start") + to("successor", "road", "right", "end")
    lanes = section(0.0, lane(1, links='<predecessor id="-1"/><successor id="-1"/>'))
    roads.append(road("back", view, length, lanes, links))
    return whole(*roads, f'<junction id="j">{"".join(connections)}</junction>\n')
