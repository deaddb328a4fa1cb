"""What the commands print: results on stdout, progress and errors on stderr."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal, TextIO

import typer

from steersman.errors import DataError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

PIPE_CLOSED = 141  # the exit code of a program whose output no longer goes anywhere
# Share of the work between two lines of progress, where there are many steps.
TOLD = 0.05
_MINUTE = 60.0
# Columns that a progress bar takes beside its words, and the least that its words have.
_BESIDE, _LEAST = 32, 20
# Letters of a name that stay beside numbers, however many there are.
_LEAST_NAME = 10
# Width of tables in files and pipes; a terminal has its own.
_WIDTH = 80


def console(stream: TextIO, like: TextIO) -> Console:
    """A console on ``stream`` that writes as for ``like``, and takes text as it is: no markup."""
    from rich.console import Console

    terminal = like.isatty()
    return Console(
        file=stream,
        force_terminal=terminal,
        width=None if terminal or "COLUMNS" in os.environ else _WIDTH,
        markup=False,
        highlight=False,
        emoji=False,
    )


def table(*columns: str, right: tuple[str, ...] = ()) -> Table:
    """An empty table with these columns; those in ``right`` hold numbers, which never break.

    Half a number reads like another one. Without numbers the first column stays unbroken.
    """
    from rich import box
    from rich.table import Table

    plain = not (sys.stdout.encoding or "").lower().startswith("utf")
    out = Table(
        box=box.ASCII2 if plain else box.SIMPLE_HEAD,
        pad_edge=False,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    for i, name in enumerate(columns):
        justify: Literal["left", "right"] = "right" if name in right else "left"
        whole = name in right or (i == 0 and not right)
        least = None if name in right else min(len(name), _LEAST_NAME)
        out.add_column(name, justify=justify, overflow="fold", no_wrap=whole, min_width=least)
    return out


def show(*items: Any) -> None:
    """Print texts and tables on stdout."""
    text = io.StringIO()
    out = console(text, like=sys.stdout)
    for item in items:
        out.print(item)
    lines = (line.rstrip() for line in text.getvalue().splitlines())
    write("\n".join(lines) + "\n")


def show_json(data: Any) -> None:
    """Print one JSON value on stdout."""
    write(json.dumps(data, indent=2, allow_nan=False) + "\n")


def write(text: str) -> None:
    """Write to stdout at once.

    Raises:
        typer.Exit: the pipe is closed.
        DataError: it cannot be written, e.g. because the disk is full.
    """
    coded = text.encode(sys.stdout.encoding or "utf-8", "replace")
    try:
        sys.stdout.write(coded.decode(sys.stdout.encoding or "utf-8"))
        sys.stdout.flush()
    except BrokenPipeError:
        _mute()
        raise typer.Exit(PIPE_CLOSED) from None
    except OSError as error:
        _mute()
        raise DataError(f"standard output: cannot be written ({error.strerror})") from None


def _mute() -> None:
    """Let what is still buffered go nowhere, so that Python does not fail at its exit."""
    try:
        descriptor = sys.stdout.fileno()
    except io.UnsupportedOperation:
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


def note(text: str) -> None:
    """A line for the reader on stderr."""
    sys.stderr.write(f"{folded(text, sys.stderr)}\n")
    sys.stderr.flush()


def folded(text: str, stream: TextIO) -> str:
    """Lines as they are, so that programs can read them; for a terminal folded between words."""
    if not stream.isatty():
        return text
    width = console(stream, like=stream).width
    return "\n".join(
        fill(line, width, break_long_words=False, break_on_hyphens=False)
        for line in text.splitlines()
    )


def animated() -> bool:
    """Whether stderr is a terminal in which bars can move."""
    return sys.stderr.isatty() and os.environ.get("TERM", "") not in {"dumb", "unknown"}


@contextmanager
def share_bar(title: str) -> Iterator[Callable[[float], None] | None]:
    """A progress bar on stderr, called with the share done; None where bars cannot move."""
    if not animated():
        yield None
        return
    with _progress("{task.description}") as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def _progress(text: str) -> Progress:
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.table import Column

    out = console(sys.stderr, like=sys.stderr)
    words = Column(no_wrap=True, overflow="ellipsis", max_width=max(out.width - _BESIDE, _LEAST))
    return Progress(
        SpinnerColumn(),
        TextColumn(text, markup=False, table_column=words),
        BarColumn(bar_width=20),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=out,
        transient=True,
    )


@contextmanager
def suite_progress() -> Iterator[Callable[[float, float], None]]:
    """A function of (simulated seconds done, in all) that draws a bar, or now and then a line."""
    if animated():
        with share_bar("driving") as update:
            assert update is not None  # it is where stderr is a terminal
            yield lambda done, total: update(done / max(total, 1.0))
        return
    shown = 0.0

    def line(done: float, total: float) -> None:
        nonlocal shown
        if done >= shown + TOLD * total or done >= total:
            shown = done
            share = 100.0 * done / max(total, 1.0)
            minutes = total >= 2 * _MINUTE
            amount, unit = (total / _MINUTE, "minutes") if minutes else (total, "seconds")
            note(f"{share:.0f} % of {amount:.0f} simulated {unit}")

    yield line


@contextmanager
def steps_bar(
    total: int, title: str, noun: str = "steps", every: float = 0.0
) -> Iterator[Callable[[float, str], None]]:
    """Called with (steps done, text): a bar in a terminal.

    Elsewhere a line each time, but no sooner than a share ``every`` of the steps after the last.
    """
    if not animated():
        due = 0.0

        def line(done: float, text: str) -> None:
            nonlocal due
            if done >= min(due, total):
                due = done + every * total
                note(f"{done:.0f}/{total} {noun}: {text}")

        yield line
        return
    with _progress("{task.description}") as bar:
        task = bar.add_task(title, total=total)
        yield lambda done, text: bar.update(task, completed=done, description=text)


@contextmanager
def steps_bars(
    total: int, titles: Sequence[str]
) -> Iterator[Callable[[str, float, str, bool], None]]:
    """Called with (title, steps done, text, whether it is new): a bar for each title.

    Elsewhere than in a terminal, a line for whatever is new.
    """
    if not animated():

        def line(title: str, done: float, text: str, new: bool) -> None:
            if new:
                note(f"{title}: {done:.0f}/{total} steps: {text}")

        yield line
        return
    with _progress("{task.description}") as bar:
        tasks = {title: bar.add_task(title, total=total) for title in titles}

        def update(title: str, done: float, text: str, _: bool) -> None:
            bar.update(tasks[title], completed=done, description=f"{title}: {text}".rstrip(": "))

        yield update
