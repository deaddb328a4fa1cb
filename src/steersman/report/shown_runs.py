"""What drives, trainings and searches show of themselves."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from steersman.episode import Episode
from steersman.learning.progress import LearningResult
from steersman.learning.seeds import TrainedSeeds
from steersman.metrics.base import summarise
from steersman.report.article import LinePlot, PlotLine, Section, Table
from steersman.report.curves import FIRST, TITLES
from steersman.report.html import render
from steersman.report.runs import ReportRun
from steersman.report.signals import signals_of
from steersman.report.tables import scaled
from steersman.report.view import ResultView, article_view
from steersman.seed_folders import seed_folder
from steersman.studies.search import SearchResult
from steersman.types import FloatArray

_MM = 1e3
AnyTraining: TypeAlias = LearningResult[Any, Any]


def drive_run(name: str, episode: Episode) -> ReportRun:
    """A drive as a page shows it."""
    return ReportRun(name, episode, summarise(episode), config=dict(episode.meta))


def shown_episode(episode: Episode) -> ResultView:
    """The replay, and the signals over time."""
    figures = [
        LinePlot(
            signal.key,
            signal.title.capitalize(),
            "time [s]",
            f"{signal.title} [{signal.unit}]",
            [PlotLine(signal.title, episode["time"], signal.values(episode))],
        )
        for signal in signals_of([episode])
    ]
    first = sum(signal.shown for signal in signals_of([episode]))
    return ResultView(figures, partial(render, [drive_run("drive", episode)], "Drive"), first)


def shown_training(result: AnyTraining) -> ResultView:
    """The curves of a training."""
    return _trainings({result.folder.name or "training": result})


def shown_seeds(result: TrainedSeeds) -> ResultView:
    """The curves of all seeds; the page has their median and range."""
    return _trainings(
        {seed_folder(one.folder.parent, s).name: one for s, one in result.trainings.items()}
    )


def _trainings(
    results: Mapping[str, AnyTraining],
) -> ResultView:
    tables = {
        name: {column: np.array(values) for column, values in result.table().items()}
        for name, result in results.items()
    }
    names = dict.fromkeys([*FIRST, *TITLES])
    runs = [ReportRun(name, training=table) for name, table in tables.items()]
    figures = [curve for name in names if (curve := _curve(name, tables)) is not None]
    return ResultView(figures, partial(render, runs, "Training"), 2)


def _curve(column: str, tables: Mapping[str, Mapping[str, FloatArray]]) -> LinePlot | None:
    """A column over the steps; None where no training has numbers in it."""
    lines = [
        PlotLine(name, table["steps"][known], table[column][known])
        for name, table in tables.items()
        if column in table and (known := np.isfinite(table[column])).any()
    ]
    title, log = TITLES[column], column.endswith("_mm")
    return LinePlot(column, title, "environment steps", title, lines, log=log) if lines else None


def shown_search(result: SearchResult) -> ResultView:
    """The trials, and the score of each."""
    trials = sorted(result.trials, key=lambda trial: (trial.score_m is None, trial.score_m))
    rows = [
        {
            "trial": trial.number,
            "state": trial.state,
            "score [mm]": scaled(trial.score_m, _MM),
            "steps": trial.steps,
            **trial.settings,
        }
        for trial in trials
    ]
    scores = [scaled(trial.score_m, _MM) for trial in result.trials]
    line = PlotLine("trials", [trial.number for trial in result.trials], scores, dots=4.0)
    figure = LinePlot("scores", "Score of each trial", "trial", "score [mm]", [line], log=True)
    section = Section(
        "Trials", result.remarks(), tables=[Table("Best first", rows)], figures=[figure]
    )
    return article_view([section], "Search of hyper-parameters")
