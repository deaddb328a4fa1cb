"""Ways through a network: along a road, between roads, or at random."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from steersman.errors import DataError
from steersman.paths.xodr.joined import gap
from steersman.paths.xodr.lane_line import Curve, changing_line, lane_line
from steersman.paths.xodr.lanes import LaneGraph, Place, Wandered, shortest, wander
from steersman.paths.xodr.model import MapFault, RoadNetwork

# Places that a search for a random way may enter in all before it gives up.
_MOST_ENTERED = 5000
# Between closer samples rounding passes for bends [m].
_CLOSE = 1e-3
# So many roads are named in a message.
_NAMED = 8
# The shortest change of lane [m], and how much farther a way may be for one less [m].
_LEAST_CHANGE, _DETOUR = 15.0, 200.0


class Ways:
    """Finds ways over the lanes of a network that a car can follow."""

    def __init__(self, network: RoadNetwork, min_radius: float = 0.0, change: float = 0.0) -> None:
        """Lanes are as they are examined.

        Args:
            network: the roads.
            min_radius: lanes that bend more sharply somewhere are not taken [m].
            change: length of a change of lane, where the lane section has room for it [m]; 0: ways
                between roads stay in their lanes.
        """
        self.network, self.graph = network, LaneGraph(network)
        self.min_radius, self.change = min_radius, change
        self._lines: dict[Place, list[Curve]] = {}
        self._faults: dict[Place, MapFault | None] = {}

    def line(self, place: Place) -> list[Curve]:
        """The centre of a place in driving direction."""
        if place not in self._lines:
            road = self.network.roads[place.road]
            section = self.graph.section(place)
            if place.entered:
                wanted = min(place.crossed * self.change, section.end - section.start)
                begin = 0.5 * (section.start + section.end - wanted)
                numbers = (place.entered, place.lane)
                numbers = numbers if self.graph.forward(place) else numbers[::-1]
                curves = changing_line(road, section, numbers, begin, begin + wanted)
            else:
                curves = lane_line(road, section, place.lane)
            if not self.graph.forward(place):
                curves = [curve.backward() for curve in curves[::-1]]
            self._lines[place] = curves
        return self._lines[place]

    def fault(self, place: Place) -> MapFault | None:
        """Why the place cannot be driven, if so: a shape that is none, a joint within that is none.

        Such a place belongs to no way.
        """
        if place not in self._faults:
            self._faults[place] = self._examined(place)
        return self._faults[place]

    def _examined(self, place: Place) -> MapFault | None:
        try:
            for a, b in pairwise(self.line(place)):
                found = gap(a, b)
                if not found.passable:
                    return MapFault(place.road, float(a.s[-1]), f"lane {place.lane}: {found}")
        except DataError as error:
            start = self.graph.section(place).start
            return MapFault(place.road, start, f"lane {place.lane}: {error}")
        return None

    def lines(self, way: Sequence[Place]) -> list[Curve]:
        """The centres of all its places."""
        return [curve for place in way for curve in self.line(place)]

    def length(self, place: Place) -> float:
        """Length of a place along its centre [m]."""
        return sum(curve.length for curve in self.line(place))

    def fits(self, place: Place) -> bool:
        """Whether the place bends nowhere more sharply than is wanted."""
        if self.min_radius <= 0.0:
            return True
        return self.fault(place) is None and self.radius(place) >= self.min_radius

    def radius(self, place: Place) -> float:
        """Radius of the sharpest bend of a place [m]; infinite on straights."""
        sharpest = max((_sharpest(curve) for curve in self.line(place)), default=0.0)
        return 1.0 / sharpest if sharpest > 0.0 else math.inf

    def next(self, place: Place) -> list[Place]:
        """The places that continue a place without a step aside, gap or kink, and fit."""
        return [
            other
            for other in self.graph.after(place)
            if self.fault(other) is None and self._meet(place, other) and self.fits(other)
        ]

    def _next_or_beside(self, place: Place) -> list[Place]:
        """The same, and all of them with a change of lane."""
        return [choice for other in self.next(place) for choice in self._beside(other)]

    def _beside(self, place: Place) -> list[Place]:
        """A place, and the changes of lane that are possible in it."""
        changes = self.graph.beside(place, min(self.change, _LEAST_CHANGE))
        return [place, *(each for each in changes if self.fault(each) is None and self.fits(each))]

    def _effort(self, place: Place) -> float:
        """Length, and a detour for each lane aside [m]."""
        return self.length(place) + _DETOUR * place.crossed

    def along(self, name: str, lane: int | None = None) -> tuple[list[Place], bool]:
        """A lane of a road as far as it goes, and whether it leads back to its beginning.

        Raises:
            DataError: there is no such road or lane.
        """
        way = self._onward(self._sound(self._starts(name, lane)[:1])[0])
        return way, way[0] in self.next(way[-1])

    def between(self, names: Sequence[str], lane: int | None = None) -> tuple[list[Place], bool]:
        """The shortest way from the beginning of one road to the end of another.

        Where the lanes do not lead there, they are changed, as seldom as possible. Names between
        the first and the last are roads to pass; where the last is the first, it is a way around.

        Raises:
            DataError: there is no such road, lane or way.
        """
        for name in names:
            self._known(name)
        around = names[0] == names[-1]
        starts = self._sound(self._starts(names[0], lane))
        found = self._shortest(names, starts, around, self.next)
        if not found and self.change > 0.0:
            if not around:  # a lap ends in the lane in which it began
                starts = [choice for start in starts for choice in self._beside(start)]
            found = self._shortest(names, starts, around, self._next_or_beside)
        if not found:
            raise self._no_way(names)
        best = min(found, key=lambda way: sum(map(self._effort, way)))
        return (best[:-1], True) if around else (best[:-1] + self._onward(best[-1]), False)

    def _shortest(
        self,
        names: Sequence[str],
        starts: Sequence[Place],
        around: bool,
        after: Callable[[Place], list[Place]],
    ) -> list[list[Place]]:
        """The shortest way from each start, if there is one."""
        ways = []
        for start in starts:
            stages: list[Callable[[Place], bool]] = [partial(self._enters, n) for n in names[1:]]
            if around:  # it ends where it began, not beside it
                stages[-1] = partial(_same, start)
            ways.append(shortest(start, stages, after, self._effort))
        return [way for way in ways if way is not None]

    def random(self, seed: int, distance: float) -> list[Place]:
        """A way of at least that length [m] that begins on a drawn lane and never comes back.

        Where none is that long, lanes are changed where one would end.

        Raises:
            DataError: none was found.
        """
        found = self._wandered(seed, distance, self.next)
        if found.way is None and self.change > 0.0:
            found = self._wandered(seed, distance, self._next_or_beside)
        if found.way is not None:
            return found.way
        sharp = f" and bends nowhere below {self.min_radius:g} m" if self.min_radius > 0.0 else ""
        raise DataError(
            f"no way of {distance:g} m was found that takes no lane twice{sharp};"
            f" the longest is {found.longest:.0f} m; set path.distance"
        )

    def _wandered(
        self, seed: int, distance: float, after: Callable[[Place], list[Place]]
    ) -> Wandered:
        """The first way that is long enough, from drawn places; else the length of the longest."""
        rng = np.random.default_rng(seed)
        starts = [place for place in self.graph.all() if self.fits(place)]
        left, longest = _MOST_ENTERED, 0.0
        for i in rng.permutation(len(starts)):
            if self.fault(starts[i]) is not None:
                continue
            # No start may use up all that is left for the others.
            most = max(left // 2, 1)
            found = wander(starts[i], distance, after, self.length, rng, most)
            longest, left = max(longest, found.longest), left - found.entered
            if found.way is not None or left <= 0:
                return found._replace(longest=longest)
        return Wandered(None, longest, 0)

    def _known(self, name: str) -> None:
        roads = self.network.roads
        if name in roads:
            return
        close = difflib.get_close_matches(name, roads, n=1)
        few = ", ".join(itertools.islice(roads, _NAMED))
        more = f" and {len(roads) - _NAMED} more" if len(roads) > _NAMED else ""
        hint = f"did you mean {close[0]!r}?" if close else f"there are: {few}{more}"
        raise DataError(f"unknown road {name!r}; {hint}")

    def _starts(self, name: str, lane: int | None) -> list[Place]:
        """Where a way may begin on a road: where it is entered, if lanes are there."""
        self._known(name)
        places = self.graph.of_road(name)
        if not places:
            lost = [str(each) for each in self.network.left_out if each.road == name]
            raise DataError("; ".join([f"road {name!r} has no lane to drive on", *lost[:1]]))
        if lane is not None:
            can = ", ".join(map(str, sorted({place.lane for place in places})))
            places = [place for place in places if place.lane == lane]
            if not places:
                raise DataError(f"road {name!r} has no lane {lane} to drive on; there are: {can}")
        return [place for place in places if self.graph.first(place)] or places[:1]

    def _sound(self, places: list[Place]) -> list[Place]:
        """Those of the places that can be driven."""
        faults = [self.fault(place) for place in places]
        sound = [place for place, fault in zip(places, faults, strict=True) if fault is None]
        if not sound:
            raise DataError(
                f"{faults[0]}; mend the map there or take another road or lane ('steersman path"
                f" check' lists all faults)"
            )
        return sound

    def _enters(self, name: str, place: Place) -> bool:
        return place.road == name and self.graph.first(place)

    def _meet(self, a: Place, b: Place) -> bool:
        before, after = self.line(a), self.line(b)
        # A section without length has no line; whether its ends meet is checked later, on the path.
        return not (before and after) or gap(before[-1], after[0]).passable

    def _onward(self, start: Place) -> list[Place]:
        """From a place to the end of its road, lane after lane."""
        way = [start]
        while True:
            ahead = [
                place
                for place in self.next(way[-1])
                if place.road == start.road and not self.graph.first(place)
            ]
            if not ahead or ahead[0] in way:
                return way
            way.append(ahead[0])

    def _no_way(self, names: Sequence[str]) -> DataError:
        """What can be reached from where the way should begin."""
        after = self._next_or_beside if self.change > 0.0 else self.next
        seen = dict.fromkeys(self._starts(names[0], None))
        todo = list(seen)
        while todo:
            new = [place for place in after(todo.pop()) if place not in seen]
            seen.update(dict.fromkeys(new))
            todo += new
        roads = [name for name in dict.fromkeys(place.road for place in seen) if name != names[0]]
        reach = ", ".join(roads[:_NAMED]) + (" and more" if len(roads) > _NAMED else "")
        sharp = f" without bends below {self.min_radius:g} m" if self.min_radius > 0.0 else ""
        kept = "" if self.change > 0.0 else " without a change of lane"
        return DataError(
            f"no lanes lead from road {' to '.join(map(repr, names))}{sharp}{kept};"
            f" from {names[0]!r} these can be reached: {reach or 'no other road'}"
        )


def _same(start: Place, place: Place) -> bool:
    return place == start


def _sharpest(curve: Curve) -> float:
    """Largest mean curvature between two samples [1/m]."""
    size = curve.steps
    turn = np.abs(np.diff(np.unwrap(curve.psi)))
    long = size > _CLOSE
    return float(np.max(turn[long] / size[long], initial=0.0))
