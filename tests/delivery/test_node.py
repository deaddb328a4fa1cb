"""The node: answers as the controller in this process, in both forms, whatever it is sent."""

from __future__ import annotations

import io
import json
import math
import struct
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from steersman.cli import app
from steersman.commands import configuration
from steersman.config import resolve
from steersman.controllers import exchange
from steersman.controllers.exchange import ANSWER, ASKED, QUESTION, Question, to_json, to_record
from steersman.delivery import serving
from steersman.delivery.compiled import compiled_controller
from steersman.delivery.controller import Setting
from steersman.delivery.node import ControllerNode
from steersman.delivery.observations import straight
from steersman.errors import ConfigError, DataError
from steersman.rollout import run
from steersman.types import Observation, Status
from steersman.vehicles import CarlaModel3

from ..scripts import ROOT, script
from .building import COMPILER, needs_compiler
from .building import run as program

CAR = CarlaModel3()
SEEN = straight(15, 2.0)._replace(lateral_error=0.1)


def node(word: str = "tuned/pid_feedforward", deadline: float | None = None) -> ControllerNode:
    return ControllerNode(resolve("controller", word), CAR, 0.05, straight(15, 2.0), deadline)


def line(question: Question) -> bytes:
    return json.dumps(to_json(question)).encode() + b"\n"


def asked(made: ControllerNode, message: bytes, sender: Any = None) -> Any:
    """The answer: an object of JSON, or the fields of a record."""
    answer = made.answer(message, sender, time.perf_counter())
    return ANSWER.unpack(answer) if message[:1] == ASKED[:1] else json.loads(answer)


def observed(k: int) -> Observation:
    return SEEN._replace(time=0.05 * k, lateral_error=0.1 * math.sin(k), heading_error=0.01 * k)


def test_both_forms_answer_as_the_controller_does_and_drives_are_apart() -> None:
    made, controller = node(), resolve("controller", "tuned/pid_feedforward")
    states: list[Any] = [controller.init(CAR, 0.05)] * 2
    for k in range(6):
        drive = k % 2
        decision, states[drive] = controller.step(states[drive], observed(k))
        question = Question(observed(k), drive, k // 2, 0.05)
        if drive:
            mark, number, sequence, status, late, steer = asked(made, to_record(question))
            assert (mark, number, sequence, late) == (exchange.ANSWERED, 1, k // 2, 0)
        else:
            answer = asked(made, line(question))
            assert answer.keys() == {"steer", "status", "drive", "sequence"}
            steer, status = answer["steer"], Status[answer["status"].upper()]
        assert (steer, status) == (decision.steer, decision.status)
        states[drive] = controller.executed(states[drive], 0.2)
        executed = Question(observed(k), drive, None, None, 0.2)
        decision, states[drive] = controller.step(states[drive], observed(k))
        assert asked(made, line(executed))["steer"] == decision.steer
    assert made.statistics().answers == 12


def test_the_sequence_finds_what_is_lost_stale_or_new() -> None:
    made = node()
    first = asked(made, line(Question(SEEN, sequence=0)))["steer"]
    asked(made, line(Question(SEEN, sequence=4)))
    said = asked(made, line(Question(SEEN, sequence=3)))
    assert said == {"error": "sequence: given 3 after 4", "drive": 0, "sequence": 3}
    # Whoever else asks, and a sequence that begins anew, begin a drive.
    assert asked(made, line(Question(SEEN, sequence=9)), "other")["steer"] == first
    assert asked(made, line(Question(SEEN, sequence=0)))["steer"] == first
    found = made.statistics()
    assert (found.answers, found.lost, found.stale, found.refused) == (4, 3, 1, 1)
    assert "3 lost, 1 out of order" in found.sentence()


def test_a_supervisor_is_told_of_what_did_not_come() -> None:
    word = {"kind": "supervisor", "inner": "tuned/lqr", "fallback": "pure_pursuit"}
    supervisor = resolve("controller", word)
    made = ControllerNode(supervisor, CAR, 0.05, straight(15, 2.0))
    state = supervisor.init(CAR, 0.05)
    for k in (0, 1, 7):
        for _ in range(5 if k == 7 else 0):
            _, state = supervisor.step(state, None)
        decision, state = supervisor.step(state, observed(k))
        assert asked(made, line(Question(observed(k), sequence=k)))["steer"] == decision.steer
    for k in range(8, 28):  # the same again and again
        answer = asked(made, line(Question(observed(7), sequence=k)))
    assert answer["status"] == "fallback"
    assert (answer["driver"], answer["reason"]) == ("fallback", "missing")


@needs_compiler
def test_the_compiled_controller_answers_as_in_python() -> None:
    controller = resolve("controller", "tuned/stanley")
    made = compiled_controller(Setting("node", controller, CAR, 0.05, 15, 2.0))
    fast = ControllerNode(made, CAR, 0.05, straight(15, 2.0))
    slow = node("tuned/stanley")
    for k in range(20):
        message = line(Question(observed(k), k % 2, None, None, 0.1 if k == 9 else None))
        answer, expected = asked(fast, message), asked(slow, message)
        assert abs(answer.pop("steer") - expected.pop("steer")) < 1e-12
        assert answer == expected
    other = asked(fast, line(Question(straight(9, 2.0))))
    assert "9 waypoints 2 m apart, the compiled controller takes 15" in other["error"]


def test_a_late_answer_says_so_and_what_cannot_be_measured_is_a_fallback() -> None:
    made = node(deadline=0.0)
    assert asked(made, line(Question(SEEN)))["late"] is True
    assert asked(made, to_record(Question(SEEN._replace(v_x=math.nan))))[3:5] == (2, 1)
    found = made.statistics()
    assert (found.missed, found.fallbacks) == (2, 1)
    assert 0.0 < found.median <= found.longest * 1.02


LINES = {
    b"x\n": "no line of JSON",
    b"[1]\n": "expected an object of JSON, given list",
    b"{}\n": "time: given nothing, expected a number",
    b"\xff\n": "no line of JSON",
    b"[" * 1000 + b"\n": "nests deeper",
    line(Question(SEEN)).replace(b'"v_x": 10.0', b'"v_x": "10"'): "v_x: given '10', expected a",
    line(Question(SEEN)).replace(
        b'"v_x": 10.0', b'"v_x": ' + b"9" * 301
    ): "a number has more than 300",
    line(Question(SEEN)).replace(b"[0.0, 0.0]", b"[0.0]"): "preview: given [0.0], expected pairs",
    line(Question(SEEN, executed=math.nan)): "executed: given nan, expected steering in [-1, 1]",
    line(Question(SEEN, drive=-1)): "drive: given -1, expected a whole number",
    line(Question(SEEN, dt=0.1)): "dt: given 0.1 s, this node was started for 0.05 s",
}


@pytest.mark.parametrize("message", LINES, ids=lambda m: LINES[m][:20])
def test_a_line_that_is_no_question_is_refused(message: bytes) -> None:
    made = node()
    assert LINES[message] in asked(made, message)["error"]
    assert "steer" in asked(made, line(Question(SEEN)))
    assert made.statistics().refused == 1


def test_a_refusal_says_which_question_it_is_about() -> None:
    made = node()
    said = asked(made, line(Question(SEEN, 3, 7)).replace(b'"v_x": 10.0', b'"v_x": "10 m/s"'))
    assert (said["drive"], said["sequence"]) == (3, 7)
    assert asked(made, line(Question(SEEN, -1, 7)))["sequence"] == 7
    assert set(asked(made, b'{"sequence": "7"}\n')) == {"error"}
    assert asked(made, to_record(Question(SEEN, 3, 7, executed=9.0)))[1:4] == (3, 7, 255)


@given(st.binary(max_size=300), st.booleans())
@settings(max_examples=60, deadline=None)
def test_no_message_ends_the_node(message: bytes, record: bool) -> None:
    made = NODE
    message = ASKED + message if record else message
    answer = made.answer(message, None, time.perf_counter())
    assert (len(answer) == ANSWER.size) if message[:1] == ASKED[:1] else answer.endswith(b"}\n")


NODE = node()


def test_a_stream_of_lines_and_records() -> None:
    made, to = node(), io.BytesIO()
    long = b" " * (3 * exchange.LONGEST) + b"\n"
    whole = line(Question(SEEN)) + b"\n" + to_record(Question(SEEN)) + long + line(Question(SEEN))
    serving.serve_stream(made, io.BytesIO(whole), to)
    to.seek(0)
    first, record = to.readline(), to.read(ANSWER.size)
    assert ANSWER.unpack(record)[3] == 0
    assert [b'"steer"' in each for each in (first, *to.readlines())] == [True, False, True]
    damaged = QUESTION.pack(ASKED, 0, 0, 10**6, *[0.0] * 11)
    with pytest.raises(DataError, match="1000000 waypoints, at most 1000 are allowed"):
        serving.serve_stream(made, io.BytesIO(damaged), to)


def test_the_layout_of_a_record_is_that_of_the_page() -> None:
    assert (QUESTION.size, ANSWER.size) == (104, 24)
    back = exchange.read_question(to_record(Question(observed(3), 1, 2, 0.05, 0.1)))
    assert np.array_equal(back.seen.preview, SEEN.preview)
    assert back.seen[:8] == observed(3)[:8]
    assert (back.drive, back.sequence, back.dt, back.executed) == (1, 2, 0.05, 0.1)
    assert struct.unpack_from("<d", to_record(Question(observed(3))), 16 + 3 * 8)[0] == (
        observed(3).lateral_error
    )


@contextmanager
def listening(count: int) -> Iterator[int]:
    """The port of a node that answers so many datagrams."""
    with serving.bound("0") as made:
        words = (NODE, made, count)
        thread = threading.Thread(target=serving.serve_udp, args=words, daemon=True)
        thread.start()
        yield made.getsockname()[1]
        thread.join(10.0)
        assert not thread.is_alive()


def test_the_client_in_python() -> None:
    with listening(20) as port:
        times, answer = script("examples/node_client.py").ask(port, 20)
    assert len(times) == 20
    assert answer["sequence"] == 19
    assert answer["steer"] < 0.0  # to the right, back to the road


@needs_compiler
def test_the_client_in_c(tmp_path: FilePath) -> None:
    source = ROOT / "examples" / "node_client.c"
    program(COMPILER, "-std=c99", "-Wall", "-Wextra", "-Werror", source, "-o", tmp_path / "ask")
    with listening(20) as port:
        said = program(tmp_path / "ask", str(port), "20")
    assert said.startswith("20 answers; status 0, steer -0.")


def test_one_steersman_drives_by_another_ones_node() -> None:
    command = [sys.executable, "-m", "steersman", "node", "tuned/lqr", "--stdin"]
    words = ["path=figure_eight", "speed=constant_speed", "duration=3"]
    outside = {"kind": "process", "command": command, "timeout": 120.0}
    episode = run(configuration("drive", words, {"controller": outside}))
    inside = run(configuration("drive", [*words, "controller=tuned/lqr"]))
    assert np.array_equal(episode["steer_command"], inside["steer_command"])


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("tuned/lqr", "give either --stdin or --udp"),
        ("tuned/lqr --udp here", "--udp: 'here' is no address; expected 127.0.0.1:PORT or PORT"),
        ("tuned/lqrr --stdin", "unknown controller 'tuned/lqrr'"),
    ],
)
def test_wrong_words(words: str, why: str) -> None:
    result = CliRunner().invoke(app, ["node", *words.split()])
    assert result.exit_code == 2
    assert why in result.stderr


def test_a_port_that_is_taken() -> None:
    with serving.bound("0") as taken:
        host, port = taken.getsockname()
        with pytest.raises(ConfigError, match="cannot be used"):
            serving.bound(f"{host}:{port}")
    assert host == "127.0.0.1"


def test_the_command_answers_its_input(tmp_path: FilePath) -> None:
    out = tmp_path / "statistics.json"
    words = ["node", "tuned/pid_feedforward", "--stdin", "--out", str(out)]
    result = CliRunner().invoke(app, words, input=line(Question(SEEN)) * 3)
    assert result.exit_code == 0, result.output
    assert [json.loads(each)["status"] for each in result.stdout.splitlines()] == ["solved"] * 3
    assert "3 answers in" in result.stderr
    assert json.loads(out.read_text())["answers"] == 3
