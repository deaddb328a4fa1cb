"""Draw docs/images/replay.png: a replay of three drives through Monza's first chicane.

Needs Playwright (extra ``dev``), Pillow, and a Chromium of the system.
"""

from __future__ import annotations

import io
import shutil
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from steersman import tuned
from steersman.config import build, read_yaml
from steersman.metrics.base import summarise
from steersman.report import ReportRun, write_report
from steersman.rollout import RunConfig, run

HERE = Path(__file__).resolve().parent
SIZE = {"width": 1280, "height": 712}
START, SECONDS = 820.0, 20.0
DRIVERS = ("policy", "pid_feedforward", "pure_pursuit")
CURSOR, CLOSER = 9.1, 2


def drive(name: str) -> ReportRun:
    """A part of a lap, with a delay of the steering that no controller is told of."""
    file = tuned.locate(f"tuned/{name}")
    controller = name if file is None else read_yaml(file)["controller"]
    tree = {
        "controller": controller,
        "path": "monza",
        "speed": {"kind": "constant_speed", "speed": 12.0},
        "plant": {"kind": "simulator", "steering_delay": 0.1},
        "start": START,
        "duration": SECONDS,
    }
    episode = run(build(RunConfig, tree))
    return ReportRun(name.replace("_", " "), episode, summarise(episode), config=dict(episode.meta))


def main() -> None:
    """Drive, write the page, and take its picture."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = write_report([drive(n) for n in DRIVERS], Path(folder) / "page.html", "Monza")
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"))
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        page.goto(page_file.as_uri())
        page.locator("#replay[data-ready]").wait_for(state="attached")
        page.locator("[data-part=slider]").fill(str(CURSOR))
        for _ in range(CLOSER):
            page.keyboard.press("+")
        page.locator("[data-part=slider]").blur()
        page.locator("#replay").evaluate("node => node.scrollIntoView()")
        page.wait_for_timeout(300)
        picture = page.screenshot()
        browser.close()
    image = Image.open(io.BytesIO(picture)).convert("RGB").quantize(128)
    image.save(HERE / "replay.png", optimize=True)


if __name__ == "__main__":
    main()
