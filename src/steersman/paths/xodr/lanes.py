"""Where a lane leads, through sections, roads and junctions; searches over lanes."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from steersman.paths.xodr.model import Lane, LaneSection, RoadNetwork, Side

DRIVABLE = frozenset(
    ("driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane")
)
"""Types of lanes that a route may take."""


class Place(NamedTuple):
    """A lane in one lane section, driven in its own direction."""

    road: str
    side: Side
    section: int
    """Number of the section among those of its side."""
    lane: int
    """Its number; where the lane is changed within the section, the one that is left last."""
    entered: int = 0
    """The lane that is changed from; 0: none."""

    def __str__(self) -> str:
        """A clause about the lane that is taken."""
        if not self.entered:
            return f"lane {self.lane} of road {self.road!r}"
        return f"the way changes from lane {self.entered} to lane {self.lane} on road {self.road!r}"

    @property
    def taken(self) -> frozenset[Place]:
        """The lanes that are driven in its section."""
        return frozenset(
            self._replace(lane=lane, entered=0) for lane in (self.lane, self.entered or self.lane)
        )

    @property
    def crossed(self) -> int:
        """How many lanes aside it leads."""
        return abs(self.lane - self.entered) if self.entered else 0


class LaneGraph:
    """The lanes of a network that can be driven, and what follows each."""

    def __init__(self, network: RoadNetwork) -> None:
        """All of ``network``."""
        self.network = network

    def section(self, place: Place) -> LaneSection:
        """The section of a place."""
        return self.network.roads[place.road].sections[place.side][place.section]

    def lane(self, place: Place) -> Lane:
        """The lane of a place."""
        return self.section(place).lanes[place.lane]

    def length(self, place: Place) -> float:
        """Length of a place along its road's reference line [m]."""
        section = self.section(place)
        return section.end - section.start

    def forward(self, place: Place) -> bool:
        """Whether it is driven towards growing s."""
        return place.side == self.network.roads[place.road].forward

    def first(self, place: Place) -> bool:
        """Whether driving on a road begins here."""
        return place.section == (0 if self.forward(place) else self._last(place))

    def _last(self, place: Place) -> int:
        return len(self.network.roads[place.road].sections[place.side]) - 1

    def of_road(self, name: str) -> list[Place]:
        """The drivable places of a road, in the order in which each side is driven."""
        road = self.network.roads[name]
        out = []
        for side in (road.forward, -road.forward):
            sections = list(enumerate(road.sections[side]))
            # Nearest to the middle first: on most roads the lane that goes on.
            out += [
                Place(name, side, index, lane.number)
                for index, section in (sections if side == road.forward else sections[::-1])
                for lane in sorted(section.lanes.values(), key=lambda lane: abs(lane.number))
                if lane.kind in DRIVABLE
            ]
        return out

    def all(self) -> list[Place]:
        """Every drivable place."""
        return [place for name in self.network.roads for place in self.of_road(name)]

    def after(self, place: Place) -> list[Place]:
        """What can be driven after a place, without a change of lane."""
        road, lane = self.network.roads[place.road], self.lane(place)
        forward = self.forward(place)
        links = lane.after if forward else lane.before
        index = place.section + (1 if forward else -1)
        if 0 <= index <= self._last(place):
            return self._known(place._replace(section=index, entered=0), *links)
        contact = road.after if forward else road.before
        if contact is None:
            return []
        if not contact.junction:
            return self._entered(contact.name, contact.at_start, links)
        return [
            found
            for way in self.network.junctions.get(contact.name, ())
            if way.incoming == place.road
            for found in self._entered(way.road, way.at_start, way.lanes.get(place.lane, ()))
        ]

    def beside(self, place: Place, room: float) -> list[Place]:
        """The same, with a change to each lane that is reached over drivable ones.

        ``room``: length of the section that each lane aside needs at least [m].
        """
        out = []
        for step in (1, -1):
            lane = place.lane + step
            while self._known(place, lane) and self.length(place) >= room * abs(lane - place.lane):
                out.append(place._replace(lane=lane, entered=place.lane))
                lane += step
        return out

    def _entered(self, name: str, at_start: bool, numbers: Sequence[int]) -> list[Place]:
        """The places on another road whose lanes are driven away from the end that is met."""
        road = self.network.roads.get(name)
        if road is None:
            return []
        side = road.forward if at_start else -road.forward
        last = len(road.sections[side]) - 1
        return (
            self._known(Place(name, side, 0 if at_start else last, 0), *numbers)
            if last >= 0
            else []
        )

    def _known(self, place: Place, *numbers: int) -> list[Place]:
        """The place with each of these lanes that is there, on this side, and can be driven."""
        lanes = self.section(place).lanes
        return [
            place._replace(lane=number)
            for number in numbers
            if number in lanes and lanes[number].kind in DRIVABLE
        ]


After: TypeAlias = Callable[[Place], Sequence[Place]]
Length: TypeAlias = Callable[[Place], float]


def shortest(
    start: Place, stages: Sequence[Callable[[Place], bool]], after: After, length: Length
) -> list[Place] | None:
    """The shortest way that passes a place of each stage, in their order; it ends at the last's.

    Dijkstra's algorithm over (place, number of stages passed). The last place costs nothing.
    """
    order = itertools.count()  # so that places are never compared, and ties are decided alike
    heap = [(0.0, next(order), start, 0)]
    came: dict[tuple[Place, int], tuple[Place, int] | None] = {(start, 0): None}
    best = {(start, 0): 0.0}
    while heap:
        cost, _, place, passed = heapq.heappop(heap)
        if passed == len(stages):
            return _traced(came, (place, passed))
        if cost > best[place, passed]:
            continue
        for other in after(place):
            state = (other, passed + stages[passed](other))
            total = cost + length(place)
            if total < best.get(state, np.inf):
                best[state], came[state] = total, (place, passed)
                heapq.heappush(heap, (total, next(order), *state))
    return None


def _traced(
    came: dict[tuple[Place, int], tuple[Place, int] | None], state: tuple[Place, int]
) -> list[Place]:
    way = []
    here: tuple[Place, int] | None = state
    while here is not None:
        way.append(here[0])
        here = came[here]
    return way[::-1]


class Wandered(NamedTuple):
    """How a random search ended."""

    way: list[Place] | None
    """A way of the wanted length, if one was found."""
    longest: float
    """Length of the longest [m]."""
    entered: int
    """How many places were entered."""


def wander(
    start: Place,
    distance: float,
    after: After,
    length: Length,
    rng: np.random.Generator,
    most: int,
) -> Wandered:
    """A way of at least ``distance`` [m] from ``start`` that never takes a lane twice.

    Goes on at random, with a change of lane where it cannot do without; where it cannot go on, it
    goes back to the last choice that is left.
    """
    way, done, longest, entered = [start], length(start), 0.0, 1
    choices, taken = [_shuffled(after(start), rng)], set(start.taken)
    while way:
        longest = max(longest, done)
        if done >= distance:
            return Wandered(way, longest, entered)
        ahead = [place for place in choices[-1] if taken.isdisjoint(place.taken)]
        if ahead and entered < most:
            choices[-1] = ahead[1:]
            way.append(ahead[0])
            taken |= ahead[0].taken
            done += length(ahead[0])
            entered += 1
            choices.append(_shuffled(after(ahead[0]), rng))
        else:
            taken -= way[-1].taken
            done -= length(way.pop())
            choices.pop()
    return Wandered(None, longest, entered)


def _shuffled(places: Sequence[Place], rng: np.random.Generator) -> list[Place]:
    """The places in a drawn order, those with a change of lane last."""
    drawn = [places[i] for i in rng.permutation(len(places))]
    return sorted(drawn, key=lambda place: place.crossed)
