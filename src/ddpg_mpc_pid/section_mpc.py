"""Sections about MPC-PID: away from home, and computing time."""

from __future__ import annotations

from ddpg_mpc_pid.page import NOTHING, ended, number, percent
from ddpg_mpc_pid.results import AwayResult, TimingResult
from ddpg_mpc_pid.tracks import LABELS
from steersman import article

# What the paper says the policy saves of the time.
_SAVED = 0.7813
# Speeds closer than this are the same [m/s].
_NEAR = 0.05


def away_section(found: AwayResult) -> article.Section:
    """The paper's words on MPC-PID away from the track and speed it was tuned for."""
    rows, home = [], found.tuned
    counts = dict.fromkeys(LABELS, 0)
    agent_held = agent_all = elsewhere = 0
    for test in found.tests:
        row = {"track": test.track.replace("_", " "), "speed [m/s]": test.speed}
        for name, run in test.mpc_pid.items():
            good = run.completed
            row[LABELS[name]] = f"{number(run.ale_mm)} mm" if good else ended(run)
        agent = test.agent
        median = number(agent.median.ale_mm, "mm") if agent.completed else NOTHING
        row["agent, median; seeds"] = f"{median}; {agent.completed} of {agent.seeds}"
        rows.append(row)
        if test.track == home.track and abs(test.speed - home.speed) < _NEAR:
            continue
        elsewhere += 1
        agent_held, agent_all = agent_held + agent.completed, agent_all + agent.seeds
        for name, run in test.mpc_pid.items():
            counts[name] += run.completed
    lost = elsewhere - counts["nominal"]
    others = "; ".join(f"{LABELS[n]}: {counts[n]}" for n in LABELS if n != "nominal")
    findings = [
        article.PageFinding(
            lost > 0,
            f"Away from home MPC-PID with true parameters stayed on the road in "
            f"{counts['nominal']} of {elsewhere} drives (the paper: it fails to; agrees: it left "
            f"at least once). {others}. The agents: {agent_held} of {agent_all}.",
        ),
        article.PageFinding(
            None,
            "Why: the linear model holds for one speed. If 'a model for each speed' stays where "
            "'true parameters' leaves, the failure is that of the fixed speed, not of MPC "
            f"({counts['scheduled']} against {counts['nominal']} drives).",
        ),
    ]
    return article.Section(
        "MPC-PID away from home",
        [
            f"Tuned on the {home.track.replace('_', ' ')} at {number(home.speed, 'm/s')}. "
            f"Speeds are capped in corners to {found.cap:g} m/s^2. Mean |d|, or where the car "
            "left the corridor.",
        ],
        findings,
        [article.Table("Drives", rows)],
    )


def timing_section(found: TimingResult) -> article.Section:
    """The paper's 78 %, for every pair of implementations."""
    rows = [
        {
            "implementation": row.name,
            "p50 [us]": row.p50_us,
            "p99 [us]": row.p99_us,
            "max [us]": row.max_us,
            "steps measured": row.steps,
            "lap [s]": row.lap_s,
            "lap": "extrapolated" if row.extrapolated else "",
            "note": row.note,
        }
        for row in found.rows
    ]
    laps = {row.name: row.lap_s for row in found.rows if row.lap_s}
    agents = [name for name in laps if name.startswith("policy")]
    baselines = [name for name in laps if name.startswith("MPC")]
    saved = {(p, m): 1.0 - laps[p] / laps[m] for p in agents for m in baselines}
    savings = [{"policy": p, "against": m, "saved [1]": share} for (p, m), share in saved.items()]
    findings = []
    if savings:
        shares = list(saved.values())
        all_or_none = {len(shares): True, 0: False}
        findings = [
            article.PageFinding(
                all_or_none.get(sum(share >= _SAVED for share in shares)),
                f"Depending on which two implementations are compared, the policy saves between "
                f"{percent(min(shares))} and {percent(max(shares))} of MPC's time a lap (the "
                "paper: 78 %; agrees: every pair saves at least that, differs: none does). The "
                "figure depends on the implementations, not on the methods; and the paper's times "
                "hold the simulator, too.",
            )
        ]
    return article.Section(
        "Computing time (the paper's 78 %)",
        [
            f"The controllers alone, in one run, on the observations of one drive; a lap has "
            f"{found.lap_steps} control steps.",
        ],
        findings,
        [
            article.Table("Times of one control step", rows),
            article.Table("Share of time that the policy saves", savings),
        ],
    )
