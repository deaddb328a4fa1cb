"""What a tuning traded: each trial's error against its steering activity, and the front of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from steersman.studies.objective import TrialCost

Row: TypeAlias = dict[str, Any]
# The two figures of which a trial on the front cannot have less of both.
TRADED = ("rms_error_m", "steer_change_rms")


def front(rows: Sequence[Mapping[str, Any]]) -> list[int]:
    """Places of the rows to which no other is better in one figure and as good in the other.

    A run that leaves the road steers less because it drives less, so only the rows with the
    fewest failures are compared. Rows without figures (of older studies) are left out.

    >>> def row(error, change, failures=0):
    ...     return {"rms_error_m": error, "steer_change_rms": change, "failures": failures}
    >>> front([row(1.0, 3.0), row(2.0, 1.0), row(2.0, 2.0), row(9.0, 0.1, failures=1), {}])
    [0, 1]
    """
    known = [i for i, row in enumerate(rows) if row.get(TRADED[0]) is not None]
    fewest = min((rows[i]["failures"] for i in known), default=0)
    kept = [i for i in known if rows[i]["failures"] == fewest]
    found, least = [], float("inf")
    for i in sorted(kept, key=lambda i: (rows[i][TRADED[0]], rows[i][TRADED[1]])):
        if rows[i][TRADED[1]] < least:
            least = rows[i][TRADED[1]]
            found.append(i)
    return sorted(found)


def trade(kind: str, trials: Sequence[Any]) -> dict[str, Any]:
    """The content of ``pareto.json``.

    Args:
        kind: the controller's kind.
        trials: Optuna's finished trials of the study; those of studies from before there were
            figures have a cost alone.

    Returns:
        ``trials``: each with ``number``, the figures of :class:`TrialCost` (None where the
        journal lacks them), ``parameters``, ``on_front`` and ``chosen``; ``failures``: the fewest
        of a trial; ``simulated_seconds`` over the ``measured`` trials.
    """
    rows = [_row(trial) for trial in trials]
    chosen = min(range(len(rows)), key=lambda i: rows[i]["cost_m"])
    best = front(rows)
    for i, row in enumerate(rows):
        row["on_front"], row["chosen"] = i in best, i == chosen
    measured = [row for row in rows if row["simulated_seconds"] is not None]
    return {
        "controller": kind,
        "traded": list(TRADED),
        "failures": min((row["failures"] for row in measured), default=None),
        "measured": len(measured),
        "simulated_seconds": sum(row["simulated_seconds"] for row in measured),
        "trials": rows,
    }


def _row(trial: Any) -> Row:
    figures = {name: trial.user_attrs.get(name) for name in TrialCost._fields}
    return {
        "number": trial.number,
        **figures,
        "cost_m": trial.value,
        "parameters": dict(trial.params),
    }
