"""Sections about driving: circle, waypoint errors, Monza."""

from __future__ import annotations

from typing import Any

from ddpg_mpc_pid.page import ended, number, percent, ratio
from ddpg_mpc_pid.plan import FULL_METHOD, METHODS
from ddpg_mpc_pid.results import (
    CircleResult,
    CircleTest,
    MonzaResult,
    RobustnessResult,
    SeedDrives,
    StudyDrive,
)
from ddpg_mpc_pid.tracks import LABELS
from steersman import article

_AGENT = METHODS[FULL_METHOD].label
_MPC_PID = "MPC-PID"
_CLOSE = 0.1


def circle_section(found: CircleResult) -> article.Section:
    """The paper's table."""
    rows: list[dict[str, Any]] = []
    findings: list[article.PageFinding] = []
    for test in found.tests:
        for driver, s in test.drivers.items():
            if s.seeds:
                rows.append(_circle_row(test.test, driver, s))
        paper = test.paper
        names = {
            "ALE, median [mm]": "ale_mm",
            "AOE [deg]": "aoe_deg",
            "SD of steering": "steer_std",
        }
        row = {heading: getattr(paper, name) for heading, name in names.items()}
        rows.append({"test": test.test, "driver": "paper's agent", **row})
        agent = test.drivers.get(_AGENT)
        if agent and agent.seeds:
            findings += _circle_findings(test, agent)
    return article.Section(
        "Circle of radius 50 m (the paper's table)",
        [
            "Median over seeds, and the worst seed. AOE is the mean heading error; the least AOE "
            "is the steady side-slip of the simulated car at the speed reached, which no "
            "controller can go below with zero lateral error; the course error is without it. The "
            "paper gives no speeds: 9.9 to 24.2 m/s are inferred from its AOE. The same throttle "
            "is not the same speed, so errors compare at equal speed. A drive that ended early "
            "counts with what it drove; the worst seed is one whose drive ended early, if there is "
            "such a drive, else that with the largest error. An ALE agrees if it is not larger "
            "than the paper's and every seed drove to the end; it differs if it is larger, or if "
            "half of the seeds or more did not.",
        ],
        findings,
        [article.Table("Errors", rows)],
    )


def _circle_row(test: str, driver: str, s: SeedDrives) -> dict[str, Any]:
    median = s.median
    return {
        "test": test,
        "driver": driver,
        "seeds that drove to the end": f"{s.completed} of {s.seeds}",
        "ALE, median [mm]": median.ale_mm,
        "worst seed [mm]": s.worst.ale_mm,
        "AOE [deg]": median.aoe_deg,
        "least AOE [deg]": s.least_aoe_deg,
        "course error [deg]": median.course_deg,
        "SD of steering": median.steer_std,
        "last half": median.steady_steer_std,
        "speed reached [m/s]": median.steady_speed,
    }


def _circle_findings(test: CircleTest, agent: SeedDrives) -> list[article.PageFinding]:
    paper, mine, name = test.paper, agent.median, test.test
    lost = agent.seeds - agent.completed
    if 2 * lost >= agent.seeds:
        text = (
            f"{name}: {lost} of {agent.seeds} seeds did not drive to the end (worst: "
            f"{ended(agent.worst)}); the paper's agent did, with {paper.ale_mm:g} mm."
        )
        return [article.PageFinding(False, text)]
    factor = ratio(mine.ale_mm, paper.ale_mm)
    out = [
        article.PageFinding(
            None if factor is None or (lost and factor <= 1.0) else factor <= 1.0,
            f"{name}: ALE {number(mine.ale_mm, 'mm')} against the paper's "
            f"{paper.ale_mm:g} mm, {number(factor)} times; "
            f"{agent.completed} of {agent.seeds} seeds drove to the end; SD of steering "
            f"{number(mine.steer_std)} against {paper.steer_std:g}.",
        )
    ]
    least = agent.least_aoe_deg
    if least and mine.aoe_deg is not None and mine.steady_aoe_deg is not None:
        away = abs(mine.steady_aoe_deg - least)
        out.append(
            article.PageFinding(
                abs(mine.aoe_deg - paper.aoe_deg) <= _CLOSE * paper.aoe_deg,
                f"{name}: AOE {number(mine.aoe_deg)} deg against {paper.aoe_deg:g} (agrees: "
                f"within {percent(_CLOSE)}); side-slip alone makes {number(least)} deg at "
                f"{number(mine.steady_speed, 'm/s')}, {number(away)} deg from what was measured "
                "in the last half.",
            )
        )
    return out


def robustness_section(found: RobustnessResult) -> article.Section:
    """The paper's figure of errors with shifted waypoints."""
    rows, lines = [], []
    for drives, words in ((found.every_step, "drawn every step"), (found.once, "drawn once")):
        agents = drives.agent
        for reach, agent, mpc in zip(found.ranges, agents, drives.mpc_pid, strict=True):
            median = agent.median
            rows.append(
                {
                    "shifts": words,
                    "range [m]": reach,
                    "agent, mean |d|, median [mm]": median.ale_mm,
                    "agent, max |d|, median [mm]": median.max_mm,
                    "worst seed, mean |d| [mm]": agent.worst.ale_mm,
                    "seeds that drove to the end": f"{agent.completed} of {agent.seeds}",
                    "MPC-PID, mean |d| [mm]": mpc.ale_mm,
                    "MPC-PID": ended(mpc),
                }
            )
        for name, values in (
            (_AGENT, [a.median.ale_mm for a in agents]),
            (_MPC_PID, [m.ale_mm if m.completed else None for m in drives.mpc_pid]),
        ):
            lines.append(article.PlotLine(f"{name}, {words}", found.ranges, values))
    series = found.series
    figures = []
    for key, title, unit in (
        ("lateral_mm", "Lateral error", "mm"),
        ("heading_deg", "Heading error", "deg"),
    ):
        over = [article.PlotLine(f"{s.range:g} m", s.time, getattr(s, key)) for s in series]
        whole = f"{title} at throttle {found.throttle:g} (median seed)"
        figures.append(article.LinePlot(key, whole, "s", unit, over))
    figures.append(article.LinePlot("range", "Mean lateral error against range", "m", "mm", lines))
    held = [
        reach
        for reach, a in zip(found.ranges, found.every_step.agent, strict=True)
        if a.seeds and a.completed == a.seeds
    ]
    findings = [
        article.PageFinding(
            bool(held) and held[-1] == found.ranges[-1],
            "With waypoints shifted anew at every step, all seeds stayed on the road with "
            + (f"{', '.join(f'{r:g}' for r in held)} m" if held else "no range")
            + f" of {', '.join(f'{r:g}' for r in found.ranges)} m (agrees: with all; the paper "
            "does not give its range).",
        )
    ]
    far, last = found.every_step.agent[-1], found.every_step.mpc_pid[-1]
    findings.append(
        article.PageFinding(
            None,
            f"With {found.ranges[-1]:g} m the agent's mean |d| is "
            f"{number(far.median.ale_mm, 'mm')} in the median and "
            f"{number(far.worst.ale_mm, 'mm')} in the worst seed, MPC-PID's "
            f"{number(last.ale_mm, 'mm')} ({ended(last)}); both see the same waypoints.",
        )
    )
    return article.Section(
        "Waypoint errors (the paper's figure of robustness)",
        ["Circle of radius 50 m; every waypoint shifted in x and y, uniformly."],
        findings,
        [article.Table("Error against range", rows)],
        figures,
    )


def monza_section(found: MonzaResult) -> article.Section:
    """The paper's figure of the racing track."""
    agent = found.agent
    rows = [{"driver": f"{_AGENT}, seed {seed}", **_lap(row)} for seed, row in found.agents.items()]
    rows += [{"driver": _MPC_PID, **_lap(found.mpc_pid)}]
    rows += [{"driver": LABELS["scheduled"], **_lap(found.scheduled)}]
    figures = []
    if (line := found.line) is not None:
        both = [("path", "path_x", "path_y"), (f"driven, seed {line.seed}", "x", "y")]
        drawn = [article.PlotLine(name, getattr(line, x), getattr(line, y)) for name, x, y in both]
        along = [article.PlotLine("lateral error", line.s, line.lateral_error)]
        figures = [
            article.LinePlot("monza", "Monza", "x [m]", "y [m]", drawn, equal=True),
            article.LinePlot("monza_error", "Lateral error along the lap", "m", "m", along),
        ]
    corners: list[dict[str, Any]] = []
    for parts in zip(*found.corners.values(), strict=True):
        corners.append({"corner": parts[0].corner})
        for driver, part in zip(found.corners, parts, strict=True):
            for kind in ("mean", "max"):
                corners[-1][f"{driver.replace('_', '-')}, {kind} |d| [mm]"] = getattr(
                    part, f"{kind}_mm"
                )
    findings = []
    if agent.seeds:
        text = (
            f"{agent.completed} of {agent.seeds} agents drove the lap that none was trained "
            f"on (agrees: all); mean |d| {number(agent.median.ale_mm, 'mm')} in the median, "
            f"{number(agent.worst.ale_mm, 'mm')} in the worst seed "
            f"({ended(agent.worst)}); "
            f"MPC-PID: {number(found.mpc_pid.ale_mm, 'mm')}, {ended(found.mpc_pid)}."
        )
        findings = [article.PageFinding(agent.completed == agent.seeds, text)]
    return article.Section(
        f"Monza at throttle {found.throttle:g} (the paper's racing track)",
        ["At this throttle the car drives about 30 km/h, for which MPC-PID is tuned."],
        findings,
        [
            article.Table("Laps", rows),
            article.Table("Corners (agent: the median seed)", corners),
        ],
        figures,
    )


def _lap(row: StudyDrive) -> dict[str, Any]:
    return {
        "mean |d| [mm]": row.ale_mm,
        "max |d| [mm]": row.max_mm,
        "mean speed [m/s]": row.speed,
        "SD of steering": row.steer_std,
        "lap": ended(row),
    }
