"""``steersman falsify``: the table, the files, going on, and wrong words."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import pytest
from typer.testing import Result

Steersman = Callable[..., Result]
WORDS = (
    *("falsify", "controller=pid", "path.radius=30", "speed.speed=9", "duration=3"),
    *("ranges={mass: 0, friction: 0, waypoint_noise: 0, speed: 0.3, delay: 0.4}",),
    *("--trials", "3", "checks=2", "bisections=2"),
)


def test_the_table_the_sentences_and_the_files(steersman: Steersman, tmp_path: FilePath) -> None:
    result = steersman(*WORDS, "--out", "f")
    assert result.exit_code == 0
    names = {file.name for file in (tmp_path / "f").iterdir()}
    assert names == {"config.yaml", "drives.jsonl", "falsify.json", "report.html", "plots"}
    found = json.loads((tmp_path / "f" / "falsify.json").read_text())
    assert found["falsified"]
    words = " ".join(result.stdout.split())
    assert f"pid fails at norm {found['safe_radius']:.3g} (off track): delay " in words
    assert f"none of {found['tried_within']} milder drives failed. That does not prove" in words
    assert "steering delay, added [s]" in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert "mildest failure at" in result.stderr
    assert 2 <= result.stderr.count(" drives: ") <= 22  # however many drives there are
    page = (tmp_path / "f" / "report.html").read_text()
    assert "A search proves failures, never safety." in page
    assert (tmp_path / "f" / "plots" / "tried.svg").read_text() in page
    assert 'id="replay"' in page
    again = steersman(*WORDS, "--out", "f", "--json")
    assert json.loads(again.stdout) == found


def test_a_controller_that_fails_at_once(
    steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    gains = "controller.gains={k_p: 0, k_i: 0, k_d: 0}"
    monkeypatch.setattr("steersman.report.falsification.find_spec", lambda _: None)
    result = steersman("falsify", "controller=pid", gains, "duration=5", "--out", "f")
    assert result.exit_code == 0
    assert "pid fails without any disturbance: off track." in result.stdout
    assert "no report.html: it needs the extra 'report'" in result.stderr
    assert not (tmp_path / "f" / "report.html").exists()


def test_an_interruption_is_told(steersman: Steersman, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("steersman.engine.journal.Journal.add", stop)
    result = steersman(*WORDS, "--out", "f")
    assert result.exit_code == 130
    assert "the same command goes on from f" in result.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("controler=pid",), "controler: unknown field; did you mean 'controller'?"),
        (("controller=pdi",), "did you mean 'pid'?"),
        (("ranges.mas=0.1",), "ranges.mas: unknown field; did you mean 'mass'?"),
        (("ranges.delay=-1",), "ranges.delay: -1"),
        (("ranges.delay=2",), "too long; at most 0.7 s"),
        (("speed=constant_throttle",), "cannot be scaled; allowed: constant_speed, nedc"),
        (("path=double_lane_change", "laps=1"), "is not closed; give a duration"),
        (("--trials", "-1"), "invalid value for '--trials'"),
        (("--duration", "5"), "settings are written key=value, like duration="),
    ],
)
def test_wrong_words_are_one_line(
    steersman: Steersman, words: tuple[str, ...], message: str
) -> None:
    result = steersman("falsify", *words, "--out", "f")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert result.exit_code == 2
