"""The page of a comparison, and its tables as text for page and terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path as FilePath
from typing import Any

from steersman.bench.along import ALONG, STEP, AlongComparison
from steersman.bench.pairs import FIGURES, PairedComparison, PathPairs
from steersman.bench.replay import ShownCase
from steersman.episode import Episode
from steersman.errors import counted
from steersman.report import benchmark
from steersman.report.article import Section, Table, write_article
from steersman.report.cases import replays
from steersman.report.charts import IntervalPlot, ShownEstimate
from steersman.report.compared_methods import seeds_figure, trainings
from steersman.report.html import render, write_report
from steersman.report.runs import ReportRun
from steersman.report.tables import difference_text, interval_text, scaled, text
from steersman.report.view import ResultView, article_view
from steersman.studies.compare.replicates import ReplicatedComparison
from steersman.studies.compare.results import (
    AnyComparison,
    CompareResult,
    DriveCompareResult,
    FieldDifference,
    ScenarioCompareResult,
)

TITLE = "Side by side"
_SHOWN = 4


def legend(found: CompareResult) -> list[tuple[str, str, str]]:
    """Letter, name and source of every contestant."""
    return [(one.letter, one.name, one.source) for one in found.contestants]


def headers(found: CompareResult, k: int) -> dict[str, str]:
    """The columns of the k-th comparison with the first contestant."""
    a, b = found.contestants[0].letter, found.contestants[k + 1].letter
    return {"figure": "figure", "base": a, "own": b, "difference": f"{b} - {a}",
            "ratio": f"{b} / {a}"}  # fmt: skip


def rows(result: AnyComparison, k: int, gap: str = " ") -> list[dict[str, str]]:
    """The k-th comparison as text, a row for each figure; ``gap`` is before an interval."""
    compared = result.comparisons[k]
    found: PairedComparison | AlongComparison | None
    found, figures = (
        (compared, FIGURES) if isinstance(compared, PairedComparison) else (compared.along, ALONG)
    )
    return [
        {
            "figure": f"{figure.label} [{figure.unit}]",
            "base": text(scaled(one.base, figure.scale), 3),
            "own": text(scaled(one.own, figure.scale), 3),
            "difference": difference_text(one.difference, figure.scale, gap),
            "ratio": interval_text(one.ratio, gap=gap),
        }
        for name, figure in figures.items()
        if found is not None and (one := found.figures.get(name)) is not None
    ]


def replicate_rows(found: ReplicatedComparison, gap: str = " ") -> list[dict[str, str]]:
    """Methods over their seeds as text; errors in mm."""
    improvements = {one.name: one.probability for one in found.improvements}
    out = []
    for one in found.methods:
        better = improvements.get(one.name)
        out.append(
            {
                "method": one.name,
                "seeds": str(len(one.runs)),
                "IQM [mm]": interval_text(one.iqm_m, 1e3, gap),
                "RMS [mm]": ", ".join(text(1e3 * run.rms_m, 3) for run in one.runs),
                "lost": ", ".join(str(run.lost) for run in one.runs),
                "P(better)": "" if better is None else interval_text(better, gap=gap),
            }
        )
    return out


def shown_seeds(found: ReplicatedComparison) -> str:
    """The seed of each method that stands for it."""
    return ", ".join(one.shown for one in found.methods if len(one.runs) > 1)


def replicate_words(found: ReplicatedComparison) -> str:
    """What the table of methods over seeds shows."""
    return (
        f"Over seeds, on {counted(found.scenarios, 'scenario')}. IQM: interquartile mean of the"
        " error over seeds and scenarios. RMS, lost: of each. P(better): that a seed has a"
        f" smaller error than one of {found.methods[0].name} on the same scenario. In brackets:"
        " 95 % intervals of a bootstrap over seeds. Everything else shows the median seed:"
        f" {shown_seeds(found)}."
    )


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:].rstrip('.')}."


def _title(found: AnyComparison, k: int) -> str:
    a, b = found.contestants[0], found.contestants[k + 1]
    return f"{b.letter} ({b.name}) against {a.letter} ({a.name})"


def sentences(found: AnyComparison, k: int) -> list[str]:
    """What the k-th comparison rests on."""
    compared = found.comparisons[k]
    title, b = _title(found, k), found.contestants[k + 1]
    if isinstance(compared, PairedComparison):
        where = f"{counted(compared.scenarios, 'scenario')} on {counted(compared.paths, 'path')}"
        better = f"{b.letter} has the smaller RMS error in {compared.better} of them"
        return [f"{title}: {where}, pair by pair; {better}."]
    return [f"{title}: {_stretch(compared.along)}", *_differing(compared.differ)]


def _stretch(along: AlongComparison | None) -> str:
    if along is None:
        return "nothing that could be compared place by place."
    return (
        f"{along.places} places {STEP:g} m apart, from {along.from_m:.0f} m to"
        f" {along.to_m:.0f} m of the path; intervals from blocks of {along.block_m:g} m."
    )


def _plain(value: Any) -> str:
    return "..." if isinstance(value, (list, dict)) else text(value)


def _differing(differ: Sequence[FieldDifference]) -> list[str]:
    """One sentence on the conditions that were not the same."""
    if not differ:
        return ["Path, vehicle, speed and all other conditions are the same."]
    shown = ", ".join(f"{d.field} ({_plain(d.base)}, {_plain(d.own)})" for d in differ[:_SHOWN])
    more = f" and {len(differ) - _SHOWN} more" if len(differ) > _SHOWN else ""
    return [f"Not under the same conditions: {shown}{more}."]


def write_comparison(
    found: AnyComparison,
    out: FilePath,
    cases: Sequence[ShownCase] = (),
    episodes: Mapping[str, Episode] | None = None,
) -> FilePath:
    """Write the page of a comparison.

    Args:
        found: the result.
        out: file of the page; a comparison over scenarios puts figures into ``plots/`` beside it.
        cases: drives to show, of a comparison over scenarios.
        episodes: the drives by name, of a comparison of drives.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
        DataError: the files cannot be written.
    """
    if isinstance(found, DriveCompareResult):
        return write_report(_runs(found, episodes or {}), out, TITLE)
    page = _sections(found, cases)
    return write_article(page, out, TITLE, _source(found), replay=replays(found.summary, cases))


def shown_comparison(found: AnyComparison) -> ResultView:
    """What a comparison shows of itself: the page without drives."""
    if isinstance(found, DriveCompareResult):
        figures = _ratios(found)
        return ResultView(figures, partial(render, _runs(found, {}), TITLE), len(figures))
    return article_view(_sections(found, ()), TITLE, _source(found))


def _ratios(found: DriveCompareResult) -> list[IntervalPlot]:
    """A chart for each drive that was compared with the first one, a row for each figure."""
    out = []
    a = found.contestants[0]
    for b, compared in zip(found.contestants[1:], found.comparisons, strict=True):
        figures = {} if compared.along is None else compared.along.figures
        points = [
            ShownEstimate(ALONG[name].label, one.ratio.value, one.ratio.low, one.ratio.high)
            for name, one in figures.items()
            if name in ALONG
        ]
        if any(point.value for point in points):
            title = f"{b.letter} ({b.name}) over {a.letter} ({a.name})"
            out.append(IntervalPlot(f"ratio_{b.letter}", title, "ratio", points))
    return out


def _source(found: ScenarioCompareResult) -> str:
    return f"{found.scenarios}, seeds {', '.join(map(str, found.seeds))}."


def _sections(found: ScenarioCompareResult, cases: Sequence[ShownCase]) -> list[Section]:
    shown = None if found.replicates is None else shown_seeds(found.replicates)
    summary = benchmark.sections(found.summary, cases, shown)
    who = [f"{letter}: {name} ({source})." for letter, name, source in legend(found)]
    notes = [*map(_sentence, found.warnings)]
    first, *more = [*_over_seeds(found), *_against(found)]
    first = first._replace(text=[*who, *first.text], warnings=notes)
    return [first, *more, *trainings(found), *summary]


def _runs(found: DriveCompareResult, episodes: Mapping[str, Episode]) -> list[ReportRun]:
    """Every drive, the legend, and every comparison as a table."""
    drives = [
        ReportRun(name, episode=episode, metrics=found.metrics[name], config=_driven(episode))
        for name, episode in episodes.items()
    ]
    who = [dict(zip(("", "drive", "from"), line, strict=True)) for line in legend(found)]
    notes = Table("To keep in mind", [], about=" ".join(map(_sentence, found.warnings)))
    tables = [Table("Drives", who), *([notes] if found.warnings else [])]
    for k in range(len(found.comparisons)):
        if lines := rows(found, k):
            title, words = _title(found, k), " ".join(sentences(found, k))
            about = _sentence(words.removeprefix(f"{title}: "))
            tables.append(Table(title, lines, headers(found, k), about=about))
    return [*drives, *(ReportRun(f"table {k}", table=each) for k, each in enumerate(tables))]


def _driven(episode: Episode) -> dict[str, Any]:
    """What was driven, as recorded."""
    config = episode.meta.get("config")
    return dict(config if isinstance(config, Mapping) else episode.meta)


def _against(found: ScenarioCompareResult) -> list[Section]:
    """A section for each comparison."""
    out: list[Section] = []
    for k, compared in enumerate(found.comparisons):
        columns = headers(found, k)
        a, b = columns["base"], columns["own"]
        points = [ShownEstimate(path, _ratio(one)) for path, one in compared.by_path.items()]
        title = f"RMS error of {b} over that of {a}, by path"
        heading = "Pair by pair, with 95 % intervals of a bootstrap over paths"
        out.append(
            Section(
                f"{b} against {a}: {compared.name}",
                sentences(found, k),
                tables=[Table(heading, rows(found, k), columns)],
                figures=[IntervalPlot(f"ratio_{b}", title, "ratio", points)],
            )
        )
    return out


def _over_seeds(found: ScenarioCompareResult) -> list[Section]:
    """The methods over their seeds; nothing if each has one."""
    if found.replicates is None:
        return []
    lines = replicate_rows(found.replicates)
    words = [replicate_words(found.replicates)]
    tables, figures = [Table("Methods over their seeds", lines)], [seeds_figure(found.replicates)]
    return [Section("Over seeds", words, tables=tables, figures=figures)]


def _ratio(one: PathPairs) -> float | None:
    return one.own / one.base if one.base else None
