"""Drives to report, and a browser for their pages.

Playwright keeps an event loop running in its thread; a browser and its loop end with the file of
tests that uses them, so that other files can run loops of their own.
"""

import shutil
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.config import build
from steersman.episode import COLUMNS, Episode
from steersman.metrics.base import summarise
from steersman.report import ReportRun, write_report
from steersman.report.article import Section, write_article
from steersman.report.scene import RoadGroup
from steersman.report.signals import ShownDrive
from steersman.rollout import RunConfig, run

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
EVIL = "</script><img src=x onerror=\"document.title='broken'\">{{ 7 * 7 }}&amp;<b>\u2028"
DESK = {"width": 1280, "height": 720}


def circle(n=200, radius=50.0, speed=10.0, offset=0.01, start=0.0, end="duration", meta=None):
    """A drive around a circle, a little to the left of it."""
    columns = {name: np.zeros(n) for name in COLUMNS}
    time = 0.05 * np.arange(n)
    s = start + speed * time
    angle, length = s / radius, 2 * np.pi * radius
    error = offset * np.cos(time)
    columns |= {
        "time": time,
        "s": s % length,
        "path_x": radius * np.sin(angle),
        "path_y": radius - radius * np.cos(angle),
        "x": (radius - error) * np.sin(angle),
        "y": radius - (radius - error) * np.cos(angle),
        "psi": angle,
        "lateral_error": error,
        "v_x": np.full(n, speed),
        "control_time": np.full(n, 20e-6),
    }
    return Episode(columns, end, speed * 0.05 * n, 0.05, length, True, meta or {})


@pytest.fixture
def drive():
    return circle


@pytest.fixture(scope="module")
def browser():
    chromium = next((found for found in map(shutil.which, NAMES) if found), None)
    if chromium is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is installed")
    api = pytest.importorskip("playwright.sync_api", reason="the extra dev has playwright")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium)
        yield browser
        browser.close()


def driven(name, **tree):
    base = {"path": "figure_eight", "speed": {"kind": "constant_speed", "speed": 12.0}}
    config = build(RunConfig, {**base, "duration": 8.0, **tree})
    episode = run(config)
    return ReportRun(name, episode, summarise(episode), config=dict(episode.meta))


@pytest.fixture(scope="module")
def drives():
    delayed = {"kind": "simulator", "steering_delay": 0.3}
    fast = {"kind": "constant_speed", "speed": 18.0}
    one = circle(n=1, meta={EVIL: EVIL})
    off = driven("off", controller="pid", plant=delayed, speed=fast)
    assert off.episode.end == "off_track"
    noisy = {"kind": "waypoints", "error_range": 0.3}
    return {
        "several": [
            driven("MPC", controller="mpc_pid"),
            driven(EVIL, controller="stanley", sensor=noisy),
            off,
            ReportRun(
                "training", training={"steps": np.arange(3.0), EVIL: np.array([9.0, 0.1, 4.0])}
            ),
        ],
        "one step": [ReportRun(EVIL, one, summarise(one), config=one.meta)],
        "off": [off],
        "nothing": [ReportRun("nothing", circle(n=0))],
    }


@pytest.fixture(scope="module")
def files(drives, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    return {
        name: write_report(each, folder / f"{name.replace(' ', '_')}.html", EVIL)
        for name, each in drives.items()
    }


@pytest.fixture(scope="module")
def article(drives, tmp_path_factory):
    groups = [
        RoadGroup(f"{EVIL} {k}", [ShownDrive(r.name, r.episode) for r in drives[name]], 1.5, [4])
        for k, name in enumerate(("off", "one step"))
    ]
    section = Section("First", [EVIL], warnings=[EVIL])
    out = tmp_path_factory.mktemp("article") / "report.html"
    return write_article([section, Section("Last")], out, EVIL, replay=groups)


@pytest.fixture
def visit(browser, files):
    """Open a page; at the end there must have been no error and no request for anything else."""
    contexts, faults = [], []

    def go(name, size=DESK, **settings):
        context = browser.new_context(viewport=size, **settings)
        contexts.append(context)
        page = context.new_page()
        address = (name if isinstance(name, FilePath) else files[name]).as_uri()
        page.on("request", lambda r: r.url not in {address, "data:,"} and faults.append(r.url))
        page.on("console", lambda m: faults.append(f"{m.type}: {m.text}"))
        page.on("pageerror", lambda e: faults.append(str(e)))
        page.set_default_timeout(20_000)
        page.goto(address)
        page.locator("#replay[data-ready]").wait_for(state="attached")
        return page

    yield go
    for context in contexts:
        context.close()
    assert not faults
