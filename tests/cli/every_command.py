"""A cheap call of every command; run as a program, all of them in the terminal that it is given."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

from steersman.policy_file import locate

SUITE = """
courses:
  a_course_with_a_long_name: {path: circle, duration: 1, speeds: {slow: constant_speed}}
  straight: {path: straight, duration: 1, speeds: {slow: constant_speed}}
"""
RECORDED: dict[str, Any] = {
    "controller": "pid",
    "path": "training_circuit",
    "speed": {"kind": "random_profile", "high": 18.0},
    "duration": 7.0,
}
RUNS = "suite=[{path: {kind: circle, radius: 30}, speed: {kind: constant_speed}, duration: 1}]"
NARROW = ("ranges={mass: 0, friction: 0, waypoint_noise: 0, speed: 0.3, delay: 0.4}", "duration=1")
NOBODY = "plant.port=1"
CARD = json.loads(locate("precision").with_suffix(".json").read_text(encoding="utf-8"))
READS = f"encoding={json.dumps(CARD['encoding'])}"
# In an order in which one makes what a later one needs.
CALLS: dict[str, tuple[str, ...]] = {
    "list": (),
    "show": ("controller", "mpc_pid"),
    "check": ("speed.constant_speed",),
    "drive": ("duration=1", "controller=pid", "--out", "drive"),
    "identify": ("recording.npz", "--holdout", "0"),
    "report": ("drive", "--out", "page.html"),
    "export": ("precision", "--to", "onnx", "--out", "export"),
    "adopt": ("policy.onnx", READS, "action=rate", "--out", "adopted"),
    "train": ("demo", "--out", "train"),
    "search": ("demo", "agent.gamma=0.9..0.99", "seeds=0", "--trials", "1", "--out", "search"),
    "imitate": ("demo", "--out", "imitate"),
    "tune": ("controller=pid", RUNS, "trials=2", "--out", "tune"),
    "falsify": ("controller=pid", *NARROW, "trials=2", "checks=2", "bisections=2", "--out", "f"),
    "bench": ("small.yaml", "--controllers", "pid,policy", "--jobs", "1", "--out", "bench"),
    "compare": ("pid", "a_controller_with_a_long_name=lqr", "suite=small.yaml", "--jobs", "1"),
    "demo": ("--policy", "policy.onnx", "--out", "demo"),
    "version": (),
    "path export": ("circle", "--to", "circle.xodr"),
    "path roads": ("circle.xodr",),
    "path check": ("circle.xodr",),
    "carla doctor": (NOBODY,),
    "carla calibrate": (NOBODY, "--out", "car.yaml"),
    "carla map": (NOBODY, "--to", "town.xodr"),
}
# Not called, and why.
LEFT_OUT = {
    "live": "serves a page until it is stopped, and prints two lines",
    "node": "answers until its input ends, and prints what it did",
    "carla serve": "goes on until it is stopped, and prints two lines",
    "reproduce": "trains for minutes; its lines are those of training and notes",
}
# What a poor terminal is given; a user's wish for no colours, and a terminal without movements.
POOR = {"NO_COLOR": "1", "TERM": "dumb"}
POORLY = ("drive", "list", "bench", "train")
MARK = "@@@"


def prepare(folder: FilePath) -> None:
    """The files that the calls name."""
    import shutil

    from steersman.config import build
    from steersman.rollout import RunConfig, run

    (folder / "small.yaml").write_text(SUITE)
    run(build(RunConfig, RECORDED)).save(folder / "recording.npz")
    for suffix in (".onnx", ".json"):
        shutil.copy(locate("precision").with_suffix(suffix), folder / f"policy{suffix}")


def _learned(config: Any, out: FilePath, reporter: Any, **words: Any) -> SimpleNamespace:
    """Nothing is learned, but much is told of it."""
    words["notify"](f"{out}: going on after so many steps{', as it was when it stopped' * 3}")
    row = {"steps": 10.0, "reward_mean": -123.456, "off_track_resets": 1234567.0, "loss": -1.5e-10}
    for name in ("validation_error_mm", "validation_rms_mm", "validation_score", "steer_activity"):
        row[name] = 1.23456e-5
    reporter(SimpleNamespace(**row, validation_failures=12345.0))
    time.sleep(0.25)  # so that a bar shows
    return SimpleNamespace(policy=out / "policy.onnx")


def _judged(order: Any, tell: Any) -> float:
    """A search's training that takes no time."""
    tell(order.config.steps)
    return 0.012345


def shorten(put: Any) -> None:
    """Put something short in place of what takes minutes, with a function like ``setattr``."""
    from steersman.bench import oracle
    from steersman.learning import train
    from steersman.learning.imitation import imitate
    from steersman.studies import demo, search

    put(search, "_trained", _judged)
    put(oracle, "_ROUNDS", 2)
    put(train, "train", _learned)
    put(imitate, "imitate", _learned)
    first = demo.tests()[:1]
    put(demo, "tests", lambda: first)


def _say(*words: str) -> None:
    sys.stderr.flush()
    sys.stdout.write(f"{' '.join((MARK, *words))}\n")
    sys.stdout.flush()


def _elsewhere(words: tuple[str, ...], folder: str) -> tuple[str, ...]:
    """The same words with another folder for results."""
    return (*words[:-1], folder) if "--out" in words else words


def main() -> None:
    """Call all, with a mark before each."""
    from steersman.cli import app

    shorten(setattr)
    calls = [(name, words, {}) for name, words in CALLS.items()]
    for word, value in POOR.items():
        calls += [(name, _elsewhere(CALLS[name], word), {word: value}) for name in POORLY]
    for name, words, environment in calls:
        _say(name, *environment)
        os.environ.update(environment)
        try:
            app(args=[*name.split(), *words], prog_name="steersman")
        except SystemExit as end:
            _say("exit", str(end.code))
        for word in environment:
            del os.environ[word]
        os.environ["TERM"] = "xterm-256color"


if __name__ == "__main__":
    main()
