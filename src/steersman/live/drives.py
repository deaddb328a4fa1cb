"""Drives of a live page: figures, and the scene that its player shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from pydantic import BaseModel

from steersman.api import noted
from steersman.api.cars import inherited
from steersman.config import dump, to_yaml
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.live.form import Choices
from steersman.metrics.base import summarise
from steersman.outcome import Attempt
from steersman.report import tables, web
from steersman.report.html import group_title, half_width
from steersman.report.runs import ReportRun
from steersman.report.scene import RoadGroup
from steersman.report.signals import group_by_path
from steersman.rollout import RunConfig, attempt

KEPT = 16
"""Drives that are kept, so that only what is new is driven."""
LONGEST = 600.0
"""Of a drive on the page [s]."""


class LiveRun(BaseModel):
    """A drive that the page asks for."""

    name: str
    choices: Choices


class DriveCache:
    """The drives of a page's configurations, the latest ones kept."""

    def __init__(self, base: RunConfig) -> None:
        """Choices are laid over ``base``."""
        self._base = base
        self._known: dict[str, Attempt] = {}

    def answer(self, runs: Sequence[LiveRun]) -> dict[str, Any]:
        """Figures and scene of the runs, the first of which is the newest.

        Raises:
            ConfigError: a word or a value is unknown or not allowed.
            DataError: a file is missing or malformed.
        """
        if not runs:
            raise ConfigError("none is given", ("runs",))
        first = runs[0].choices
        config = first.config(self._base)
        shown = [self._run(run.name, run.choices.config(self._base)) for run in runs]
        error = self._known[_key(config)].error
        return {
            **scene(shown),
            "figures": _figures(shown),
            "command": first.command(),
            "yaml": to_yaml(config),
            "note": None if error is None else str(error),
            "hints": self._hints(config, first),
        }

    def _hints(self, config: RunConfig, choices: Choices) -> list[str]:
        """What the command line would say of this drive, but what the car's file leaves out."""
        word = choices.parts["controller"].word if "controller" in choices.parts else ""
        left = inherited(config.vehicle)
        lines = noted.before(config, [f"controller={word}"])
        lines += noted.after(config, self._known[_key(config)].episode)
        return [line for line in lines if left is None or left not in line]

    def _run(self, name: str, config: RunConfig) -> ReportRun:
        key = _key(config)
        if key not in self._known:
            if (config.duration or 0.0) > LONGEST:
                raise ConfigError(
                    f"{config.duration:g} is not allowed; the page drives up to {LONGEST:g} [s]",
                    ("duration",),
                )
            self._known[key] = attempt(config)
        self._known[key] = self._known.pop(key)  # the latest is last
        for old in list(self._known)[:-KEPT]:
            del self._known[old]
        return _run_of(name, self._known[key].episode)


def _key(config: RunConfig) -> str:
    """Changes with the configuration, and with the files that it names."""
    names = {v for name, v in _leaves(dump(config)) if name == "file" and isinstance(v, str)}
    files = [FilePath(name) for name in sorted(names)]
    stamps = [file.stat().st_mtime_ns for file in files if file.is_file()]
    return f"{config.model_dump_json()} {stamps}"


def _leaves(tree: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Names and values of a tree."""
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            yield from _leaves(value, str(key))
    elif isinstance(tree, list):
        for value in tree:
            yield from _leaves(value, name)
    else:
        yield name, tree


def _run_of(name: str, episode: Episode) -> ReportRun:
    return ReportRun(name, episode, summarise(episode), config=dict(episode.meta))


def answer_of(name: str, episode: Episode, end: str | None = None) -> dict[str, Any]:
    """Figures and scene of one drive, with other words for its end where some are given."""
    shown = [_run_of(name, episode)]
    figures = _figures(shown)
    if end is not None:
        figures["rows"][0]["cells"][0]["text"] = end
    return {**scene(shown), "figures": figures}


def scene(runs: Sequence[ReportRun]) -> dict[str, Any]:
    """What the player shows, as :func:`steersman.report.web.parts` packs it.

    Waypoints are those of the first run alone.
    """
    newest = runs[0].episode
    groups = [
        [drive._replace(waypoints=drive.episode is newest) for drive in group]
        for group in group_by_path(runs)
    ]
    found = web.parts([RoadGroup(group_title(g), g, half_width(g)) for g in groups])
    return {name: found[name] for name in ("data", "columns_data")}


def _figures(runs: Sequence[ReportRun]) -> dict[str, Any]:
    """The summary's figures, a row for each and a column for each run."""
    columns = tables.summary_columns(runs)
    cells = [tables.summary_row(run, columns)[2:] for run in runs]
    headers = ["end", *(column.header.replace("-", "") for column in columns)]
    units = ["", *(column.unit for column in columns)]
    return {
        "runs": [run.name for run in runs],
        "rows": [
            {"name": name, "unit": unit, "cells": [row[k]._asdict() for row in cells]}
            for k, (name, unit) in enumerate(zip(headers, units, strict=True))
        ],
    }
