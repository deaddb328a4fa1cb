"""The section about training methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ddpg_mpc_pid.plan import FULL_METHOD
from ddpg_mpc_pid.words import finding, interval, number, percent, verdict

_ALONE = "ddpg"
_CLAIMED = "both"
# What the paper's figure shows: the adaptive reward is a reward of its own.
_LOSSES = (("track", "tracking reward alone"), ("fixed", "demonstration reward, fixed"))
# A seed whose best error is above this has never driven [mm].
_LOST = 1000.0
# The largest error on the way to which a saving is reported [m].
_ASKED = 0.1


def line(method: Mapping[str, Any], column: str, scale: float = 1.0) -> dict[str, Any]:
    """A column over training: median and quartiles over seeds."""
    curve = method["curves"][column]
    out = {"name": method["label"], "x": curve["steps"]}
    for key, name in (("y", "median"), ("low", "low"), ("high", "high")):
        out[key] = [scale * v for v in curve[name]]
    return out


def _against_time(method: Mapping[str, Any]) -> dict[str, Any]:
    error, clock = method["curves"]["validation_error_mm"], method["curves"]["seconds"]
    count = min(len(error["median"]), len(clock["median"]))
    columns = {"y": "median", "low": "low", "high": "high"}
    out = {"name": method["label"], "x": clock["median"][:count]}
    return out | {key: error[name][:count] for key, name in columns.items()}


def figure(file: str, title: str, x: str, y: str, lines: list[Any], log: bool) -> dict[str, Any]:
    """A figure of lines."""
    return {"file": file, "title": title, "x": x, "y": y, "lines": lines, "log": log}


def method_row(method: Mapping[str, Any]) -> dict[str, Any]:
    """A row of the table of methods."""
    low, _, high = method["best_quartiles"]
    return {
        "method": method["label"],
        "seeds": method["seeds"],
        "diverged": method["diverged"],
        "never": sum(best is None or best > _LOST for best in method["best_mm"]),
        "best": interval(method["best_iqm"]),
        "spread": f"{number(low)} to {number(high)}",
        "last": interval(method["last_iqm"]),
        "mean": interval(method["mean_over_training_iqm"]),
        "resets": float(np.median(method["resets"])) if method["resets"] else None,
        "seconds": float(np.median(method["seconds"])) if method["seconds"] else None,
    }


COLUMNS = {
    "method": "method",
    "seeds": "seeds",
    "diverged": "diverged",
    "never": "never drove",
    "best": "best error, IQM [mm]",
    "spread": "its quartiles [mm]",
    "last": "last error, IQM [mm]",
    "mean": "mean over training, IQM [mm]",
    "resets": "off-track resets, median",
    "seconds": "computing time, median [s]",
}


def learning_section(results: Mapping[str, Any]) -> dict[str, Any]:
    """The paper's figure of losses, and what matters more: errors, resets, savings, spread."""
    learning = results["learning"]
    methods = {k: m for k, m in learning["methods"].items() if not m["ablation"]}
    figures = [
        figure(
            "validation",
            "Mean error on the validation set",
            "environment steps",
            "mm",
            [line(m, "validation_error_mm") for m in methods.values()],
            True,
        ),
        figure(
            "validation_time",
            "The same against computing time (wall time on a core of its own)",
            "s",
            "mm",
            [_against_time(m) for m in methods.values()],
            True,
        ),
        figure(
            "resets",
            "Off-track resets so far",
            "environment steps",
            "resets",
            [line(m, "off_track_resets") for m in methods.values()],
            False,
        ),
    ]
    for reward, words in _LOSSES:
        same = [m for m in methods.values() if m["reward"] == reward]
        for column, name in (("actor_loss", "Actor loss"), ("critic_loss", "Critic loss")):
            lines = [line(m, column) for m in same]
            title = f"{name}: {words}"
            file = f"{column}_{reward}"
            figures.append(figure(file, title, "environment steps", name.lower(), lines, False))
    return {
        "title": "Training methods (the paper's figure of losses)",
        "text": [
            "Median and quartiles over seeds. Losses stand together only where the reward is the "
            "same. The validation set are random roads that no training sees; a drive that "
            "fails is charged 1.5 m for its remaining time.",
            "Savings: 1 - (restricted mean with demonstration) / (restricted mean of DDPG alone). "
            "A seed that never gets to the error is charged all that the longest training spent, "
            "so a saving holds up to that horizon; how many seeds got there stands beside it. "
            "Where no seed of either got there, nothing is said.",
        ],
        "findings": [
            *_saving_findings(learning),
            *_spread_findings(learning),
            *_collapsed(learning["methods"]),
            *_smooth(methods),
        ],
        "tables": [
            {
                "title": "Methods",
                "columns": COLUMNS,
                "rows": [method_row(m) for m in methods.values()],
            },
            _saving_table(learning),
        ],
        "figures": figures,
    }


def _saving_table(learning: Mapping[str, Any]) -> dict[str, Any]:
    rows = []
    for s in learning["savings"]:
        row: dict[str, Any] = {
            "to": f"{s['threshold_m']} m",
            "method": learning["methods"][s["method"]]["label"],
            "reached": f"{s['reached']} of {s['seeds'][1]}",
            "alone": f"{s['alone_reached']} of {s['seeds'][0]}",
        }
        for cost in ("steps", "seconds", "off_track_resets"):
            row[cost] = interval(s[cost]["saving"], 100.0)
        rows.append(row)
    columns = {
        "to": "mean error",
        "method": "method",
        "reached": "seeds that got there",
        "alone": "alone",
        "steps": "steps saved [%]",
        "seconds": "time saved [%]",
        "off_track_resets": "resets saved [%]",
    }
    return {"title": "What the demonstration saves", "columns": columns, "rows": rows}


def _saving_findings(learning: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The claim: training is accelerated. It holds where the interval lies above zero."""
    out = []
    for s in learning["savings"]:
        if s["method"] not in (_CLAIMED, FULL_METHOD) or s["threshold_m"] > _ASKED:
            continue
        label = learning["methods"][s["method"]]["label"]
        goal = f"On the way to {s['threshold_m']} m"
        saving = s["steps"]["saving"]
        if saving is None:
            text = f"{goal}: no seed of '{label}' or of DDPG alone got there in this many steps."
            out.append(finding(None, text))
            continue
        known = verdict(saving)
        end = {
            True: "the demonstration accelerates training",
            False: "the demonstration slows training down",
            None: "the interval holds zero, so these seeds do not decide it",
        }[known]
        others = ", ".join(
            f"{interval(s[cost]['saving'], 100.0)} % of {words}"
            for cost, words in (("seconds", "the time"), ("off_track_resets", "the resets"))
        )
        out.append(
            finding(
                known,
                f"{goal} '{label}' saved {interval(saving, 100.0)} % of the steps, {others}; "
                f"{s['reached']} of {s['seeds'][1]} seeds got there, alone {s['alone_reached']} "
                f"of {s['seeds'][0]}: {end}.",
            )
        )
    return out


def _spread_findings(learning: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The claim: training is stabilised, read as a smaller spread over seeds."""
    out = []
    for s in learning["spread"]:
        if s["method"] in (_CLAIMED, FULL_METHOD):
            label = learning["methods"][s["method"]]["label"]
            text = (
                f"Interquartile range over seeds of the best error: {number(s['range_mm'], 'mm')} "
                f"with '{label}' (median {number(s['median_mm'], 'mm')}), "
                f"{number(s['alone_mm'], 'mm')} alone (median "
                f"{number(s['alone_median_mm'], 'mm')}); smaller by {interval(s['smaller_by'])} mm "
                "(agrees: the interval lies above zero; note: it holds zero)."
            )
            out.append(finding(verdict(s["smaller_by"]), text))
    return out


def _collapsed(methods: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What the paper does not report: seeds that never learn to drive."""
    counts = {m["label"]: method_row(m)["never"] for m in methods.values()}
    lost = [f"{n} with '{label}'" for label, n in counts.items() if n]
    if not lost:
        return []
    return [
        finding(
            None,
            f"Seeds that never drove (best error over {_LOST / 1e3:g} m): {', '.join(lost)}. Their "
            "policy soon sits at one limit of the action, where its gradient vanishes; neither "
            "demonstration nor time frees it.",
        )
    ]


def _smooth(methods: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The claim: with both parts the actor loss falls smoothly."""
    if not {_ALONE, _CLAIMED} <= methods.keys():
        return []
    shares = []
    for name in (_ALONE, _CLAIMED):
        steps = np.diff(methods[name]["curves"]["actor_loss"]["median"])
        shares.append(float((steps > 0.0).mean()) if steps.size else None)
    alone, both = shares
    known = None if alone is None or both is None or alone == both else both < alone
    return [
        finding(
            known,
            f"The median actor loss rose from one validation to the next in {percent(both)} of "
            f"the cases with both, in {percent(alone)} alone (the paper: smoother with both). A "
            "falling actor loss says that Q grows, not that the car drives better: see the errors.",
        )
    ]
