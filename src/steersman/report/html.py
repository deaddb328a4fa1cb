"""One self-contained page: tables, plots, configuration; nothing is fetched from anywhere.

The plotting library is put into the page compressed (a third of its size) and unpacked by the
browser; the page's own content security policy forbids every connection.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman import core_yaml
from steersman.errors import DataError, SteersmanError
from steersman.files import write_text
from steersman.report import tables
from steersman.report.runs import Run
from steersman.report.signals import SIGNALS, Drive, group_by_path, look, plotted
from steersman.report.training import curves

if TYPE_CHECKING:
    from jinja2 import Template

# Half the width of the corridor that is drawn where a run does not say how wide it was [m].
CORRIDOR = 1.5
_MISSING = "a report needs more packages: pip install 'steersman[report]'"
# Lengths of dashes in a legend of the page, as the plotting library draws them.
_DASHES = {"solid": "none", "dash": "7 4", "dot": "2 3", "dashdot": "7 3 2 3"}


def write_report(
    runs: Sequence[Run],
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


def render(runs: Sequence[Run], title: str) -> str:
    """The page as text."""
    groups = group_by_path(runs)
    training = curves(runs)
    data = {
        "groups": plotted(groups, [half_width(group) for group in groups]),
        "panels": [{"key": signal.key, "title": signal.title} for signal in SIGNALS],
        "training": training,
    }
    has_plots = bool(groups or training)
    return _template().render(
        title=title,
        style=_resource("page.css"),
        script=_resource("page.js") if has_plots else "",
        library=_packed(_plotly()) if has_plots else "",
        data=_packed(json.dumps(data, separators=(",", ":"), allow_nan=False)),
        columns=tables.SUMMARY,
        summaries=_summaries(runs, groups),
        all_metrics=tables.all_metrics(_measured(runs)),
        measured=[run.name for run in _measured(runs)],
        tables=[tables.grid(run.table) for run in runs if run.table],
        groups=[
            (group_title(group), _legend([d.name for d in group]), f"{half_width(group):g}")
            for group in groups
        ],
        trainings=_legend([run.name for run in runs if run.training is not None]),
        has_curves=bool(training and training["panels"]),
        configs=_configs(runs),
    )


def group_title(group: Sequence[Drive]) -> str:
    """What the path of these drives is called: its kind, if recorded, and its length."""
    episode = group[0].episode
    path = _recorded(group).get("path")
    kind = path.get("kind") if isinstance(path, Mapping) else path
    name = str(kind).replace("_", " ") if isinstance(kind, str) else "path"
    shape = "loop" if episode.closed else "open path"
    return f"{name[:1].upper()}{name[1:]}, {shape} of {episode.path_length:.4g} m"


def half_width(group: Sequence[Drive]) -> float:
    """Half the width of the corridor, as recorded with the group's first run [m]."""
    width = _recorded(group).get("corridor")
    return float(width) if isinstance(width, (int, float)) else CORRIDOR


def _recorded(group: Sequence[Drive]) -> Mapping[str, Any]:
    meta = group[0].episode.meta
    inner = meta.get("config")
    return inner if isinstance(inner, Mapping) else meta


def _resource(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _template() -> Template:
    try:
        from jinja2 import Environment, StrictUndefined
    except ModuleNotFoundError:
        raise SteersmanError(_MISSING) from None
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.from_string(_resource("page.html.j2"))


def _plotly() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError:
        raise SteersmanError(_MISSING) from None
    return str(get_plotlyjs())


def _packed(content: str) -> str:
    """Compressed (with no time stamp: same runs, same page) and in letters."""
    return base64.b64encode(gzip.compress(content.encode(), mtime=0)).decode()


def _measured(runs: Sequence[Run]) -> list[Run]:
    return [run for run in runs if run.metrics]


def _summaries(
    runs: Sequence[Run], groups: Sequence[Sequence[Drive]]
) -> list[tuple[str, list[tuple[str, list[tables.Cell]]]]]:
    """Rows of the summary table under the title of their path."""
    rows = {run.name: tables.summary_row(run) for run in _measured(runs) if run.training is None}
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


def _configs(runs: Sequence[Run]) -> list[tuple[str, str]]:
    """Each configuration once, under the names of all runs that had it."""
    names: dict[str, list[str]] = {}
    for run in runs:
        if run.config:
            content = core_yaml.dump(json.loads(json.dumps(dict(run.config), default=str)))
            names.setdefault(content, []).append(run.name)
    return [(", ".join(dict.fromkeys(same)), content) for content, same in names.items()]
