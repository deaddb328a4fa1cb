"""Searches over places: the shortest way, and a random one that never comes back."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from steersman.paths.xodr.lanes import Place

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
    """A way of at least ``distance`` [m] from ``start`` that never enters a place twice.

    Goes on at random; where it cannot go on, it goes back to the last choice that is left.
    """
    way, done, longest, entered = [start], length(start), 0.0, 1
    choices = [_shuffled(after(start), rng)]
    while way:
        longest = max(longest, done)
        if done >= distance:
            return Wandered(way, longest, entered)
        ahead = [place for place in choices[-1] if place not in way]
        if ahead and entered < most:
            choices[-1] = ahead[1:]
            way.append(ahead[0])
            done += length(ahead[0])
            entered += 1
            choices.append(_shuffled(after(ahead[0]), rng))
        else:
            done -= length(way.pop())
            choices.pop()
    return Wandered(None, longest, entered)


def _shuffled(places: Sequence[Place], rng: np.random.Generator) -> list[Place]:
    return [places[i] for i in rng.permutation(len(places))]
