"""Draw the replays: ``python docs/images/replay.py [monza] [ice]``.

``replay.png``: three drives through Monza's first chicane. ``ice.png``: a car that finds out how
slippery a road is and slows down, beside one that drives as fast as wished.

Needs Playwright (extra ``dev``), Pillow, and a Chromium of the system.
"""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from playwright.sync_api import sync_playwright

from steersman import tuned
from steersman.bench.beyond import beyond_grip
from steersman.config import build, read_yaml, resolve
from steersman.metrics.base import summarise
from steersman.report import ReportRun, write_report
from steersman.rollout import RunConfig, run

HERE = Path(__file__).resolve().parent
SIZE = {"width": 1280, "height": 712}


class Replay(NamedTuple):
    """A picture: who drives, at which time [s] it is taken, and how often it is magnified."""

    file: str
    title: str
    drive: Callable[[str], RunConfig]
    drivers: tuple[str, ...]
    cursor: float
    closer: int


def chicane(name: str) -> RunConfig:
    """A part of a lap, with a steering delay that no controller gets."""
    file = tuned.locate(f"tuned/{name}")
    tree = {
        "controller": name if file is None else read_yaml(file)["controller"],
        "path": "monza",
        "speed": {"kind": "constant_speed", "speed": 12.0},
        "plant": {"kind": "simulator", "steering_delay": 0.1},
        "start": 820.0,
        "duration": 20.0,
    }
    return build(RunConfig, tree)


def ice(name: str) -> RunConfig:
    """A road of ice; friction is no part of what controllers get."""
    wanted = ("clothoid_102", "ice_1.15")
    found = next(s for s in beyond_grip().scenarios() if (s.path, s.disturbance) == wanted)
    controller = {"kind": "grip_speed", "found": True} if name == "grip_speed" else f"tuned/{name}"
    sensor = found.run.sensor.model_copy(update={"count": 41})
    changes = {"controller": resolve("controller", controller), "sensor": sensor}
    return found.run.model_copy(update=changes)


REPLAYS = {
    "monza": Replay(
        "replay", "Monza", chicane, ("policy", "pid_feedforward", "pure_pursuit"), 9.1, 2
    ),
    "ice": Replay("ice", "Ice", ice, ("grip_speed", "mpc_delay"), 5.5, 1),
}


def shown(name: str, config: RunConfig) -> ReportRun:
    """The drive, for the page."""
    episode = run(config)
    return ReportRun(name.replace("_", " "), episode, summarise(episode), config=dict(episode.meta))


def draw(replay: Replay) -> None:
    """Drive, write the page, and take its picture."""
    runs = [shown(name, replay.drive(name)) for name in replay.drivers]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = write_report(runs, Path(folder) / "page.html", replay.title)
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        page.goto(page_file.as_uri())
        page.locator("#replay[data-ready]").wait_for(state="attached")
        page.locator("[data-part=slider]").fill(str(replay.cursor))
        for _ in range(replay.closer):
            page.keyboard.press("+")
        page.locator("[data-part=slider]").blur()
        page.locator("#replay").evaluate("node => node.scrollIntoView()")
        page.wait_for_timeout(300)
        picture = page.screenshot()
        browser.close()
    image = Image.open(io.BytesIO(picture)).convert("RGB").quantize(128)
    image.save(HERE / f"{replay.file}.png", optimize=True)


if __name__ == "__main__":
    for word in sys.argv[1:] or REPLAYS:
        draw(REPLAYS[word])
