"""A world with its fleet and its lesson as one object, which a call hands over as one pointer.

numba takes tables apart at each call from Python, array by array, which for the sixty of a world
and its fleet takes longer than the step of a vehicle.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.experimental import structref

from steersman.kernels.compiled import allocating
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.step import Lesson
from steersman.kernels.step import step as step_lesson
from steersman.kernels.world import advance
from steersman.types import FloatArray


@structref.register
class _BoundType(types.StructRef):
    """numba's type of :class:`Bound`, by the types of its fields."""

    def preprocess_fields(self, fields: Any) -> Any:
        return tuple((name, types.unliteral(field)) for name, field in fields)


class Bound(structref.StructRefProxy):
    """World, fleet and lesson (or None), as :func:`bind` makes it."""


structref.define_proxy(Bound, _BoundType, ["world", "fleet", "lesson"])


@allocating
def bind(world: World, fleet: Fleet, lesson: Lesson | None) -> Bound:
    """The arrays of all three, shared; numbers are copied."""
    return Bound(world, fleet, lesson)


@allocating
def move(bound: Any, commands: FloatArray) -> None:
    """Move each vehicle by one control period under steering commands (N,) in [-1, 1]."""
    for n in range(commands.shape[0]):
        advance(bound.world, bound.fleet, n, commands[n])


@allocating
def learn(bound: Any, actions: FloatArray) -> None:
    """:func:`steersman.kernels.step.step` under actions (N,) in [-1, 1]."""
    step_lesson(bound.world, bound.fleet, bound.lesson, actions)
