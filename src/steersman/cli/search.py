"""``steersman search``: the hyper-parameters of a training."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import typer

from steersman.cli import settings
from steersman.cli.outcome import goes_on
from steersman.cli.output import note, show, show_json, steps_bar, table

if TYPE_CHECKING:
    from steersman.studies.search import SearchResult

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman search demo --trials 20 --out runs/search\n"
    "  steersman search demo agent.gamma=0.9..0.99 agent.learning_rate.start=1e-4..3e-3:log \\\n"
    "      problem.task.c_change='100|300|1000' seeds=0..2 --out runs/search\n"
    "  steersman train runs/search/best.yaml seeds=10..14 --out runs/five\n"
    "\n"
    "The same command goes on where an interrupted search stopped."
)
_SHOWN = 10


def search(
    out: settings.Out,
    words: settings.PresetWords = None,
    trials: Annotated[int, typer.Option("--trials", min=1, help="Trials in all.")] = 20,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    as_json: settings.AsJson = False,
) -> None:
    """Search the hyper-parameters of a training with Optuna.

    A setting that is searched is written key=LOW..HIGH, key=LOW..HIGH:log or key='A|B|C'; without
    any the agent's own are. Every trial trains with each of the seeds (seeds=0,1); poor ones are
    stopped early. Writes search.json, best.yaml and a folder for each trial.
    """
    import steersman as sm

    lines: dict[int, str] = {}
    with goes_on(out), steps_bar(trials, "searching", "trials") as update:

        def tell(trial: int, text: str, best: float) -> None:
            lines[trial] = text
            known = "" if math.isnan(best) else f", best {1e3 * best:.4g} mm"
            update(trial, f"trial {trial}: {text}{known}")

        result = sm.search(
            *(words or []),
            out=out,
            trials=trials,
            progress=tell,
            engine=engine,
            jobs=jobs,
            notify=note,
        )
    if as_json:
        show_json(result.plain())
    else:
        _show(result, out)
    for remark in result.remarks():
        note(remark)


def _show(result: SearchResult, out: str) -> None:
    rows = table("trial", "state", "steps", "score [mm]", "settings", right=("steps", "score [mm]"))
    order = sorted(result.trials, key=lambda one: (-one.steps, one.score_m or math.inf))
    for one in order[:_SHOWN]:
        score = "-" if one.score_m is None else f"{1e3 * one.score_m:.4g}"
        words = "\n".join(f"{name}={_short(value)}" for name, value in one.settings.items())
        rows.add_row(str(one.number), one.state, str(one.steps), score, words)
    show(rows)
    if len(order) > _SHOWN:
        show(f"and {len(order) - _SHOWN} more in search.json")
    seeds = ", ".join(map(str, result.seeds))
    show(
        "",
        f"best: trial {result.best.number}, chosen on seeds {seeds}; judge it with other seeds:",
        f"  steersman train {out}/best.yaml seeds=10..14 --out DIR",
    )


def _short(value: str) -> str:
    """Four digits of a number; anything else as it is."""
    try:
        return f"{float(value):.4g}"
    except ValueError:
        return value
