"""How long the live page takes from a change to the new figures and replay, in a browser.

    python benchmarks/live.py --out results/benchmarks/live.json

Opens the page in headless Chromium, moves a slider again and again, and measures in the page
from the slider's event to the frame after the figures and the replay of a minute's drive stand
there. Beside the best and the median there is the processor time of server and page, which other
processes of the machine do not lengthen (their sum is what an idle machine takes, but for what
the browser does outside the page's thread), and the machine's load.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import uvicorn
from playwright.sync_api import sync_playwright

from steersman.commands import configuration
from steersman.files import write_text
from steersman.live import server
from steersman.live.page import HOST, LiveAddress
from steersman.provenance import provenance
from steersman.rollout import RunConfig

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
GOAL_MS = 300
ROUNDS, FIRST = 20, 120
CONTROLLERS = ("pid_feedforward", "pure_pursuit", "stanley", "lqr", "mpc_pid")
# Moves a slider of the vehicle, which is a new design for every controller, by whole steps, so that
# each change is a drive that the server does not have.
CHANGE = """async (steps) => {
  const slider = document.querySelector("input[type=range][aria-label='vehicle.mass']");
  const took = document.getElementById("took");
  const shown = new Promise((done) => new MutationObserver((_, watch) => {
    watch.disconnect();
    requestAnimationFrame(() => setTimeout(() => done(performance.now()), 0));
  }).observe(took, { childList: true, characterData: true, subtree: true }));
  const begun = performance.now();
  slider.value = Number(slider.min) + steps * Number(slider.step);
  slider.dispatchEvent(new Event("input"));
  return (await shown) - begun;
}"""


@contextmanager
def serving(config: RunConfig) -> Any:
    """The address of a server in a thread of this process."""
    address = LiveAddress(server.free_port(0), server.new_token())
    app = server.live_app(config, address)
    running = uvicorn.Server(
        uvicorn.Config(
            app, host=HOST, port=address.port, log_level="error", ws="none", lifespan="off"
        )
    )
    thread = threading.Thread(target=running.run, daemon=True)
    thread.start()
    while not running.started:
        time.sleep(0.01)
    try:
        yield address
    finally:
        running.should_exit = running.force_exit = True
        thread.join(10.0)


def busy(thread: Any) -> float:
    """Processor time of the page's main thread [s]."""
    metrics = thread.send("Performance.getMetrics")["metrics"]
    return float(next(one["value"] for one in metrics if one["name"] == "TaskDuration"))


def measured(browser: Any, controller: str) -> dict[str, float]:
    """What the changes of one controller's drive took."""
    words = ["path=figure_eight", "speed=constant_speed", "speed.speed=12", "duration=60"]
    with serving(configuration("drive", [f"tuned/{controller}", *words])) as address:
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(address.url)
        page.wait_for_function("() => Boolean(document.getElementById('took').textContent)")
        page.evaluate(CHANGE, FIRST)  # compiles, and has a drive before it from now on
        thread = page.context.new_cdp_session(page)
        thread.send("Performance.setTimeDomain", {"timeDomain": "threadTicks"})
        thread.send("Performance.enable")
        begun, before = time.process_time(), busy(thread)
        took = [page.evaluate(CHANGE, FIRST + 1 + k) for k in range(ROUNDS)]
        cpu = (time.process_time() - begun) / ROUNDS
        shown = (busy(thread) - before) / ROUNDS
        page.close()
    return {
        "best_ms": round(min(took)),
        "median_ms": round(statistics.median(took)),
        "server_cpu_ms": round(1e3 * cpu),
        "page_cpu_ms": round(1e3 * shown),
        "rounds": ROUNDS,
    }


def main() -> None:
    """Measure and print; with ``--out`` write the record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="record, a JSON file")
    out = parser.parse_args().out
    chromium = next(filter(None, map(shutil.which, BROWSERS)), None)
    before = os.getloadavg()[0]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium)
        found = {name: measured(browser, name) for name in CONTROLLERS}
        browser.close()
    for name, row in found.items():
        words = ", ".join(f"{key} {value}" for key, value in row.items())
        sys.stdout.write(f"{name}: {words}\n")
    machine = {"cpus": os.cpu_count(), "load": [round(before, 1), round(os.getloadavg()[0], 1)]}
    sys.stdout.write(f"goal {GOAL_MS} ms; {machine}\n")
    if out is not None:
        record = {
            "command": " ".join(["python", *sys.argv]),
            **provenance(),
            **machine,
            "goal_ms": GOAL_MS,
            "controllers": found,
        }
        write_text(out, json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
