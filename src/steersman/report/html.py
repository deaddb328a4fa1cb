"""One self-contained page: replay, tables, training, configuration; nothing is fetched.

Everything that is drawn, the script of :mod:`steersman.report.web` draws on canvases from the
page's own data; the page's content security policy forbids every connection.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman import core_yaml
from steersman.errors import DataError
from steersman.files import write_text
from steersman.naming import shown_name
from steersman.report import tables, web
from steersman.report.curves import curves
from steersman.report.runs import ReportRun
from steersman.report.scene import RoadGroup
from steersman.report.seen import recorded
from steersman.report.signals import ShownDrive, group_by_path, look
from steersman.report.tables import text
from steersman.table_file import flat

# Half the width of the corridor that is drawn where a run does not say how wide it was [m].
CORRIDOR = 1.5
LIMIT = 5_000_000
"""Bytes that a page may have; rows are thinned until it does."""
LONG = 12
"""Tables and lists with more rows are folded up, those of tables behind the shorter ones."""
# Lengths of dashes in a legend.
_DASHES = {"solid": "none", "dash": "7 4", "dot": "2 3", "dashdot": "7 3 2 3"}


def write_report(
    runs: Sequence[ReportRun],
    out: FilePath,
    title: str = "Steersman report",
) -> FilePath:
    """Write the report of ``runs`` as one HTML file that works offline.

    Args:
        runs: what to report, e.g. from ``load_runs``.
        out: the file to write.
        title: heading of the page.

    Returns:
        The file that was written.

    Raises:
        DataError: there is nothing to report, or the file cannot be written.
        SteersmanError: the extra ``report`` is not installed.
    """
    if not runs:
        raise DataError("nothing to report")
    write_text(FilePath(out), render(runs, title))
    return FilePath(out)


def render(runs: Sequence[ReportRun], title: str) -> str:
    """The page as text."""
    groups = group_by_path(runs)
    training = curves(runs)
    roads = [RoadGroup(group_title(group), group, half_width(group)) for group in groups]
    shown = [without_folder(part) for road in roads for part in by_conditions(road)]
    page = web.template("page.html.j2")
    content = {
        "title": title,
        "style": web.resource("page.css"),
        "columns": tables.summary_columns(runs),
        "tiles": _tiles(runs),
        "notes": _notes(runs),
        "summaries": _summaries(runs, groups),
        "all_metrics": tables.all_metrics(_measured(runs)),
        "measured": [run.name for run in _measured(runs)],
        "tables": sorted(
            (tables.grid(run.table) for run in runs if run.table),
            key=lambda grid: len(grid.rows) > LONG,
        ),
        "long": LONG,
        "has_drives": bool(groups),
        "trainings": _legend([line["name"] for line in training["runs"]] if training else []),
        "has_curves": bool(training and training["panels"]),
        "configs": _configs(runs),
    }
    return web.within(
        LIMIT, lambda rows: page.render(**content, **web.parts(shown, training, rows))
    )


def _notes(runs: Sequence[ReportRun]) -> list[str]:
    """What is worth a word about the drives, each by its name where there are several."""
    named = len(runs) > 1
    return [
        f"{run.name}: {note}" if named else note
        for run in runs
        if run.episode is not None
        for note in run.episode.notes
    ]


def _tiles(runs: Sequence[ReportRun]) -> list[tables.Tile]:
    """The main figures in large letters, where there is one drive and nothing else."""
    return tables.tiles(runs[0]) if len(runs) == 1 and runs[0].episode is not None else []


def group_title(group: Sequence[ShownDrive]) -> str:
    """What the path of these drives is called, if recorded, and its length."""
    episode = group[0].episode
    name = shown_name(episode.meta, "path") or "path"
    name = f"{name[:1].upper()}{name[1:]}"
    shape = "loop" if episode.closed else "open path"
    return f"{name}, {shape} of {episode.path_length:.4g} m"


def half_width(group: Sequence[ShownDrive]) -> float:
    """Half the width of the corridor, as recorded with the group's first run [m]."""
    width = recorded(group[0].episode).get("corridor")
    return float(width) if isinstance(width, (int, float)) else CORRIDOR


def _measured(runs: Sequence[ReportRun]) -> list[ReportRun]:
    return [run for run in runs if run.metrics]


def _summaries(
    runs: Sequence[ReportRun], groups: Sequence[Sequence[ShownDrive]]
) -> list[tuple[str, list[tuple[str, list[tables.Cell]]]]]:
    """Rows of the summary table under the title of their path."""
    columns = tables.summary_columns(runs)
    driven = [run for run in _measured(runs) if run.training is None]
    rows = {run.name: tables.summary_row(run, columns) for run in driven}
    out = []
    for group in groups:
        mine = [(d.name, rows.pop(d.name)) for d in group if d.name in rows]
        out.append((group_title(group), mine))
    return [*out, ("Metrics only", list(rows.items()))] if rows else out


def _legend(names: Sequence[str]) -> list[dict[str, str]]:
    looks = [look(k) for k in range(len(names))]
    return [
        {"name": name, "color": line["color"], "dashes": _DASHES[line["dash"]]}
        for name, line in zip(names, looks, strict=True)
    ]


def _configs(runs: Sequence[ReportRun]) -> list[tuple[str, str]]:
    """Each configuration once, under the names of all runs that had it."""
    names: dict[str, list[str]] = {}
    for run in runs:
        if run.config:
            content = core_yaml.dump(json.loads(json.dumps(dict(run.config), default=str)))
            names.setdefault(content, []).append(run.name)
    return [(", ".join(dict.fromkeys(same)), content) for content, same in names.items()]


CROWD = 6
"""Up to so many drives are shown together whatever their conditions."""
# Parts of a configuration that are no conditions: the controller, and what the group shares.
_OTHERS = ("controller", "path", "seed")


def by_conditions(group: RoadGroup) -> list[RoadGroup]:
    """The group, or, of a crowd, one group for each set of conditions; their titles tell them."""
    if len(group.drives) <= CROWD:
        return [group]
    found = [_conditions(drive) for drive in group.drives]
    keys = list(dict.fromkeys(key for one in found for key in one))
    # Fields that only some kinds have differ if those that have them do.
    differ = [k for k in keys if len({json.dumps(one[k]) for one in found if k in one}) > 1]
    parts: dict[str, list[ShownDrive]] = {}
    for drive, one in zip(group.drives, found, strict=True):
        words = ", ".join(f"{key} {text(one[key])}" for key in differ if key in one)
        parts.setdefault(words, []).append(drive)
    # Where every drive is on its own, nothing is gained.
    if len(parts) in {1, len(found)}:
        return [group]
    return [_named(group, words, drives) for words, drives in parts.items()]


def without_folder(group: RoadGroup) -> RoadGroup:
    """The group with its drives' names less their folder, where all of them are in the same."""
    if len(group.drives) == 1 or len({d.name.rpartition("/")[0] for d in group.drives}) > 1:
        return group
    drives = [d._replace(name=d.name.rpartition("/")[2]) for d in group.drives]
    return group._replace(drives=drives)


def _conditions(drive: ShownDrive) -> dict[str, Any]:
    config: Mapping[str, Any] = recorded(drive.episode)
    return flat({key: value for key, value in config.items() if key not in _OTHERS})


def _named(group: RoadGroup, words: str, drives: Sequence[ShownDrive]) -> RoadGroup:
    title = f"{group.title}: {words}" if words else f"{group.title}: conditions not recorded"
    return group._replace(title=title, drives=drives)
