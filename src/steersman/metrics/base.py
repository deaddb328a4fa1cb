"""How a metric is declared, and the values of all metrics of a drive.

A metric is a function of an :class:`~steersman.episode.Episode`, declared with :func:`metric`. The
declaration is all that tables, benchmarks and reports need; a package of its own declares one in
the same way and names it as an entry point. Definitions and sources are in ``docs/metrics.md``.
"""

from __future__ import annotations

import itertools
import math
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Literal, TypeAlias, TypeVar

import numpy as np

from steersman.config import Component, components, register
from steersman.episode import Episode
from steersman.errors import suggestion

Value: TypeAlias = float | int | bool | None
Values: TypeAlias = dict[str, Value]
MetricFunction: TypeAlias = Callable[[Episode], float | None]
F = TypeVar("F", bound=MetricFunction)

_PLACES = itertools.count()


class Metric(Component):
    """A figure of a drive; made by :func:`metric`."""

    unit: ClassVar[str] = "-"
    shown_in: ClassVar[tuple[str, float] | None] = None
    """The unit of tables to read, and how many of it one ``unit`` is; None: ``unit`` itself."""
    meaning: ClassVar[str] = ""
    better: ClassVar[Literal["lower", "higher"] | None] = None
    """Which values are better; None if neither are."""
    dtype: ClassVar[type[float] | type[int] | type[bool]] = float
    steady: ClassVar[bool] = False
    """Whether it is also given for the last half of a drive, where the start has died away."""
    benchmark: ClassVar[bool] = False
    """Whether only benchmarks give it."""
    place: ClassVar[int] = 0
    """Order of declaration, which is that of the tables."""
    function: ClassVar[MetricFunction]

    @classmethod
    def of(cls, episode: Episode) -> Value:
        """The value; None where it is undefined (the function gives None, NaN or infinity)."""
        with np.errstate(over="ignore", invalid="ignore"):
            value = cls.function(episode)
        return cls.dtype(value) if value is not None and math.isfinite(value) else None


def readable(kind: type[Metric], value: Any) -> tuple[str, Any]:
    """The unit that tables to read have for a metric, and a value in it."""
    unit, factor = kind.shown_in or (kind.unit, None)
    return unit, value if factor is None or value is None else factor * value


def metric(
    name: str,
    unit: str,
    meaning: str,
    better: Literal["lower", "higher"] | None = None,
    **others: Any,
) -> Callable[[F], F]:
    """Function decorator: declare a metric.

    Args:
        name: key in results and column in tables; ends in the unit, if there is one.
        unit: unit of the value, "-" for none.
        meaning: a few words for tables.
        better: which values are better; None if neither are.
        others: further class attributes of :class:`Metric`.
    """

    def declare(function: F) -> F:
        words = f"\n\nUnit: {unit}." + (f" {better.capitalize()} is better." if better else "")
        attributes = {
            "__module__": function.__module__,
            "__qualname__": function.__qualname__,
            "__doc__": f"{(function.__doc__ or meaning).strip()}{words}",
            "unit": unit,
            "meaning": meaning,
            "better": better,
            "place": next(_PLACES),
            "function": staticmethod(function),
            **others,
        }
        cls = types.new_class(function.__name__, (Metric,), {}, lambda ns: ns.update(attributes))
        register("metric", name)(cls)
        return function

    return declare


def metrics(*, benchmark: bool = False) -> dict[str, type[Metric]]:
    """The metrics of a drive by name, in the order of their declaration, plug-ins included.

    Args:
        benchmark: also those that only benchmarks give, behind the others.
    """
    found = [cls for cls in components("metric").values() if issubclass(cls, Metric)]
    chosen = [cls for cls in found if benchmark or not cls.benchmark]
    return {cls.kind: cls for cls in sorted(chosen, key=lambda cls: (cls.benchmark, cls.place))}


def last_half(episode: Episode) -> Episode:
    """The episode cut to the last half of its rows (rows are equal in time).

    Of an odd number the middle row is kept, so that a run of one row keeps it. Only the columns
    are cut; ``distance`` and ``end`` are still those of the whole run.
    """
    start = len(episode) // 2
    return replace(episode, columns={name: v[start:] for name, v in episode.columns.items()})


def evaluate(episode: Episode, chosen: Mapping[str, type[Metric]] | None = None) -> Values:
    """The values of the chosen metrics (by default of :func:`metrics`), None where undefined."""
    table = metrics() if chosen is None else chosen
    return {name: cls.of(episode) for name, cls in table.items()}


def summarise(episode: Episode) -> dict[str, Any]:
    """All metrics of a run, how it ended, and under ``steady`` those of its last half.

    Returns:
        Plain data without NaN, ready for JSON: numbers, booleans, ``end`` as a string, ``steady``
        as a mapping; None where a metric is undefined.
    """
    table = metrics()
    steady = {name: cls for name, cls in table.items() if cls.steady}
    values = evaluate(episode, table)
    return {"end": episode.end, **values, "steady": evaluate(last_half(episode), steady)}


class DriveMetrics(Mapping[str, Value]):
    """The figures of a drive by name, also as attributes; None where one is undefined."""

    def __init__(self, episode: Episode) -> None:
        """Compute all metrics of the drive."""
        values = summarise(episode)
        self.end: str = values.pop("end")
        """How the drive ended."""
        self.steady: Values = values.pop("steady")
        """Those of its last half, where the start has died away."""
        self._values: Values = values

    def __getitem__(self, name: str) -> Value:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __getattr__(self, name: str) -> Value:
        values: Values = self.__dict__.get("_values", {})
        if name not in values:
            raise AttributeError(f"no metric {name!r}{suggestion(name, values)}")
        return values[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def __repr__(self) -> str:
        shown = {name: f"{v:.4g}" if isinstance(v, float) else v for name, v in self.items()}
        width = max(map(len, shown))
        rows = (f"{name:{width}}  {v}  {metrics()[name].meaning}" for name, v in shown.items())
        return "\n".join([f"ended by {self.end}", *rows])
