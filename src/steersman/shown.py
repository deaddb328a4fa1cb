"""Results show themselves: a line in a terminal, a page in a notebook, figures, tables, files.

A class says in a line what it is and which table it holds. Its page and its figures are made by
:mod:`steersman.report`, which lies above the results and is found by name once something is shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from os import PathLike
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, ClassVar

from steersman.errors import DataError, SteersmanError, how_to_install, suggestion
from steersman.table_file import WRITERS, Columns, write_columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure as PlotFigure
    from pandas import DataFrame

_MISSING = f"it needs {how_to_install('notebook')}"


class Shown:
    """Base of results that show themselves."""

    shown_by: ClassVar[str]
    """``module:function`` that makes the :class:`steersman.report.view.ResultView` of a result."""

    def line(self) -> str:
        """The result in one line."""
        raise NotImplementedError

    def table(self) -> Columns:
        """The result as columns of equal length by name."""
        raise NotImplementedError

    def units(self) -> Mapping[str, str]:
        """The unit of each column whose name does not end in it."""
        return {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that are printed beneath the line."""
        return ()

    def __repr__(self) -> str:
        return "\n  note: ".join([self.line(), *self.notes])

    def __str__(self) -> str:
        return repr(self)

    def _view(self) -> Any:
        module, _, function = self.shown_by.partition(":")
        return getattr(import_module(module), function)(self)

    def _repr_html_(self) -> str:
        """The page of the result for a notebook, in a frame of its own; it loads nothing."""
        framed: str = import_module("steersman.report.view").framed(self._view())
        return framed

    def plot(self, *names: str) -> PlotFigure:
        """Draw figures of the result below each other.

        Args:
            names: which of them; none: those that matter most.

        Raises:
            ConfigError: there is no figure of that name; the message has those that there are.
            SteersmanError: the extra ``notebook`` is not installed.
        """
        drawn: PlotFigure = import_module("steersman.report.plots").drawn(self._view(), names)
        return drawn

    def to_pandas(self) -> DataFrame:
        """The table of the result as a ``pandas.DataFrame``.

        Raises:
            SteersmanError: the extra ``notebook`` is not installed.
        """
        try:
            from pandas import DataFrame
        except ModuleNotFoundError:
            raise SteersmanError(f"pandas is not installed; {_MISSING}") from None
        return DataFrame(dict(self.table()))

    def save(self, file: str | PathLike[str]) -> None:
        """Write the result as what the file's name ends in, replacing a file only when complete.

        ``.csv``, ``.mat`` and ``.parquet`` (extra ``bench``) hold the table; other endings are
        those of :meth:`savers`.

        Raises:
            DataError: the file cannot be written, or its name ends in something else.
            SteersmanError: an extra is not installed.
        """
        place, savers = FilePath(file), self.savers()
        if place.suffix in savers:
            savers[place.suffix](place)
        elif place.suffix in WRITERS:
            write_columns(place, self.table(), self.units())
        else:
            allowed = suggestion(place.suffix, [*savers, *WRITERS])
            raise DataError(f"{place}: {place.suffix!r} is no ending of a result's file{allowed}")

    def savers(self) -> Mapping[str, Any]:
        """What writes the result whole, a function of the file by its ending."""
        return {}
