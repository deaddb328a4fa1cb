"""What a result shows: figures, and a page that a notebook frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from typing import NamedTuple

from steersman.report.article import Figure, Section, article_page

HEIGHT = 760
"""Of the frame in a notebook [pixels]."""


class ResultView(NamedTuple):
    """What a result shows."""

    figures: Sequence[Figure]
    page: Callable[[], str]
    """Makes the page, which loads nothing."""
    first: int = 1
    """So many figures are drawn where none is named."""


def article_view(sections: Sequence[Section], title: str, source: str = "") -> ResultView:
    """A result of which a page of sections is made."""
    figures = [figure for section in sections for figure in section.figures]
    return ResultView(figures, partial(article_page, sections, title, source))


def framed(view: ResultView) -> str:
    """The page in a frame: its styles and its script stay apart from those of the notebook.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
    """
    return (
        f'<iframe sandbox="allow-scripts" srcdoc="{escape(view.page())}" title="Steersman" '
        f'style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'
    )
