"""Coming and going: every way in which a server can be missing, wrong, taken or lost."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from steersman.cli import app
from steersman.errors import ConfigError, PlantError
from steersman.outcome import PlantFailure
from steersman.paths.analytic import Circle, Straight
from steersman.plants import carla_server, carla_session, carla_steps
from steersman.plants.carla import CarlaConfig
from steersman.plants.carla_plant import CarlaPlant
from steersman.plants.carla_server import check_version, retried
from steersman.plants.carla_session import ROLE
from steersman.plants.carla_world import world_of
from steersman.rollout import run
from steersman.types import Command, Pose
from steersman.vehicles import CarlaModel3

from ..standin.serving import serving
from .conftest import config, left_behind, running, synchronous

START = Pose(0.0, 0.0, 0.0)
HOLD = Command(0.0, 0.4, 0.0)


@contextmanager
def driving(carla: CarlaConfig, speed: float = 8.0) -> Iterator[CarlaPlant]:
    """A plant that drives on a straight."""
    plant = carla.make(CarlaModel3())
    try:
        plant.enter(Straight())
        plant.reset(START, speed, 0.0)
        yield plant
    finally:
        plant.close()


# -------------------------------------------------------------------------------- no server


@contextmanager
def listening() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


def test_nobody_listens(lib: Any) -> None:
    with listening() as listener:
        port = listener.getsockname()[1]
    begun = time.monotonic()
    message = rf":{port}: no CARLA server \(connection refused\); start it .*plant\.port"
    with pytest.raises(PlantError, match=message):
        config(port, timeout=60.0).make(CarlaModel3())
    assert time.monotonic() - begun < 10.0  # not the whole time-out


def test_a_server_that_is_starting_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    monkeypatch.setattr(time, "sleep", pauses.append)
    answers = iter([PlantError("no"), PlantError("not yet"), "there"])

    def attempt() -> str:
        answer = next(answers)
        if isinstance(answer, PlantError):
            raise answer
        return answer

    assert retried(attempt, 3) == "there"
    assert pauses[1] == 2.0 * pauses[0] > 0.0
    answers = iter([PlantError("no"), PlantError("not yet"), "there"])
    with pytest.raises(PlantError, match="not yet"):
        retried(attempt, 2)


def test_somebody_who_never_answers(lib: Any) -> None:
    with listening() as listener:
        port = listener.getsockname()[1]
        with pytest.raises(PlantError, match=r"no answer within 0\.5 s; .*plant\.port"):
            config(port, timeout=0.5).make(CarlaModel3())


@pytest.mark.parametrize(
    "words",
    [
        b"SSH-2.0-OpenSSH_9.2\r\n",
        b"HTTP/1.0 400 Bad request\r\n\r\n",
        b"\xc1" * 64,
        b"\x94\x01\x07\xc0\xc0",  # an answer to another question
        b"\xdd\xff\xff\xff\xff",  # an array that would fill the memory
        b"",
    ],
)
def test_somebody_who_is_no_carla_server(lib: Any, words: bytes) -> None:
    """The client itself would end the process."""

    def answer() -> None:
        stream, _ = listener.accept()
        with stream:
            stream.recv(64)
            stream.sendall(words)

    with listening() as listener:
        other = threading.Thread(target=answer)
        other.start()
        with pytest.raises(PlantError, match="something answers, but not as a CARLA server does"):
            config(listener.getsockname()[1]).make(CarlaModel3())
        other.join()


@pytest.mark.parametrize(
    ("server", "cure"),
    [
        ("0.9.15", "pip install carla==0.9.15"),
        ("0.9.14-dirty", r"0\.9\.15 and 0\.9\.16 are supported"),
        ("what", "are supported"),
    ],
)
def test_another_version_is_refused(server: str, cure: str) -> None:
    with pytest.raises(
        PlantError, match=rf"server is CARLA {server}, the client 0\.9\.16; .*{cure}"
    ):
        check_version(server, "0.9.16")


def test_the_version_of_the_server_is_checked(
    carla: CarlaConfig, monkeypatch: pytest.MonkeyPatch, raw: Any
) -> None:
    monkeypatch.setattr(carla_server, "SPOKEN", ("0.9.99",))
    with pytest.raises(PlantError, match=r"0\.9\.16-stand-in, the client 0\.9\.16; "):
        carla.make(CarlaModel3())
    assert left_behind(raw) == (False, 0)


# -------------------------------------------------------------------------------- leaving


def test_what_was_taken_is_given_back(carla: CarlaConfig, raw: Any) -> None:
    with driving(carla) as plant:
        world = raw.get_world()
        settings = world.get_settings()
        assert settings.synchronous_mode
        assert settings.fixed_delta_seconds == pytest.approx(0.05)
        assert settings.max_substep_delta_time == pytest.approx(0.01)
        assert settings.max_substeps == 10
        plant.step(HOLD)
        # Another client may not have heard of that tick yet.
        ours = plant.session.world.get_actors().filter("vehicle.*")
        assert [actor.attributes["role_name"] for actor in ours] == [ROLE]
    assert left_behind(raw) == (False, 0)
    plant.close()  # twice is no harm


def test_an_exception_leaves_nothing_behind(carla: CarlaConfig, raw: Any) -> None:
    with pytest.raises(ZeroDivisionError), driving(carla):
        raise ZeroDivisionError
    assert left_behind(raw) == (False, 0)


def test_a_failed_start_leaves_nothing_behind(carla: CarlaConfig, raw: Any) -> None:
    wrong = carla.model_copy(update={"vehicle": "vehicle.tesla.model4"})
    with pytest.raises(PlantError, match=r"no 'vehicle\.tesla\.model4'; did you mean '.*model3'"):
        run(running(plant=wrong, duration=1.0))
    missing = carla.model_copy(update={"map": "Town99"})
    with pytest.raises(PlantError, match="has no map 'Town99'"):
        run(running(plant=missing, duration=1.0))
    assert left_behind(raw) == (False, 0)


DRIVE = (sys.executable, "-c", "from steersman.cli import main; main()", "drive", "duration=600")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_leaves_nothing_behind(carla: CarlaConfig, raw: Any, number: signal.Signals) -> None:
    words = ("plant=carla", f"plant.port={carla.port}", "plant.warm_up=0.1")
    process = subprocess.Popen(
        [*DRIVE, *words, "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        until = time.monotonic() + 60.0
        while not synchronous(raw):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < until
            time.sleep(0.2)
        world = raw.get_world()
        for _ in range(80):  # past spawning and the run-up
            world.wait_for_tick(20.0)
        process.send_signal(number)
        out, error = process.communicate(timeout=30.0)
    finally:
        if process.poll() is None:
            process.kill()
    assert process.returncode == 130, error
    assert '"interrupted"' in out  # what was driven until then is told
    assert left_behind(raw) == (False, 0)


# ---------------------------------------------------------------------- stale, shared, taken


def abandon(plant: CarlaPlant) -> None:
    """What a crash does: the connection ends, the server waits on."""
    import atexit

    atexit.unregister(plant.session.close)
    plant.session.client = plant.session.world = None
    plant._actor = None


def test_a_stale_session_is_recovered(carla: CarlaConfig, raw: Any) -> None:
    plant = carla.model_copy(update={"rendering": False}).make(CarlaModel3())
    plant.enter(Straight())
    plant.reset(START, 5.0, 0.0)
    abandon(plant)
    assert synchronous(raw)
    with driving(carla) as again:
        assert "left in synchronous mode by a client that is gone" in again.session.notes[0]
        assert "1 of its vehicles" in again.session.notes[0]
        assert not again.session._found.no_rendering_mode
        assert again.step(HOLD).v_x == pytest.approx(8.0, abs=0.5)
        assert len(again.session.world.get_actors().filter("vehicle.*")) == 1
    assert left_behind(raw) == (False, 0)


def test_a_server_that_another_client_drives_is_left_alone(carla: CarlaConfig, raw: Any) -> None:
    world, done = raw.get_world(), threading.Event()
    settings = world.get_settings()
    settings.synchronous_mode, settings.fixed_delta_seconds = True, 0.05
    world.apply_settings(settings)

    def tick() -> None:
        while not done.wait(0.02):
            world.tick(20.0)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        with pytest.raises(PlantError, match="another client is driving this server"):
            carla.make(CarlaModel3())
        assert world.get_settings().synchronous_mode  # that client goes on
    finally:
        done.set()
        thread.join()
        settings.synchronous_mode, settings.fixed_delta_seconds = False, None
        world.apply_settings(settings)


def test_another_clients_ticks_are_noticed(carla: CarlaConfig, raw: Any) -> None:
    with driving(carla) as plant:
        plant.step(HOLD)
        plant.session.world = Early(plant.session.world)
        with pytest.raises(PlantError, match="another client ticks this server too"):
            plant.step(HOLD)


class Early:
    """A world whose snapshot is newer than the tick that was asked for."""

    def __init__(self, world: Any) -> None:
        self._world = world

    def tick(self, _: float) -> int:
        return int(self._world.tick(20.0)) - 1

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)


def test_a_taken_place_is_told_with_what_stands_there(
    carla: CarlaConfig, raw: Any, lib: Any
) -> None:
    plant = carla.make(CarlaModel3())
    try:
        plant.enter(Straight())
        library = plant.session.world.get_blueprint_library()
        other = library.find("vehicle.lincoln.mkz_2020")
        where = lib.Transform(lib.Location(0.3, 0.2, 0.1))
        stranger = plant.session.world.spawn_actor(other, where)
        with pytest.raises(PlantError, match=rf"collides; nearest is actor {stranger.id}, .*mkz"):
            plant.reset(START, 5.0, 0.0)
        stranger.destroy()
        plant.reset(START, 5.0, 0.0)
    finally:
        plant.close()
    assert left_behind(raw) == (False, 0)


def test_a_vehicle_that_somebody_destroys_is_told_and_replaced(
    carla: CarlaConfig, raw: Any
) -> None:
    with driving(carla) as plant:
        number = plant._actor.id
        raw.get_world().get_actor(number).destroy()
        with pytest.raises(PlantError, match=f"vehicle {number} was destroyed by another client"):
            plant.step(HOLD)
        assert plant.reset(START, 6.0, 0.0).v_x == pytest.approx(6.0, abs=1e-4)
    with driving(carla) as plant:  # between two runs
        raw.get_world().get_actor(plant._actor.id).destroy()
        assert plant.reset(START, 6.0, 0.0).v_x == pytest.approx(6.0, abs=1e-4)


def test_off_the_road_it_is_put_back(carla: CarlaConfig) -> None:
    with driving(carla) as plant:
        for _ in range(40):
            state = plant.step(Command(0.5, 0.6, 0.0))
        assert abs(state.y) > 5.0
        again = plant.reset(START, 8.0, 0.0)
        assert (again.x, again.y, again.psi) == pytest.approx(START, abs=1e-5)
        assert again.yaw_rate == pytest.approx(0.0, abs=1e-4)


def test_steps_come_after_a_reset(carla: CarlaConfig) -> None:
    plant = carla.make(CarlaModel3())
    try:
        with pytest.raises(PlantError, match="reset comes before the first step"):
            plant.step(HOLD)
    finally:
        plant.close()


# ---------------------------------------------------------------------------- lost in mid-run


def test_a_server_that_dies_in_mid_run() -> None:
    with serving() as own:
        plant = config(own.port, timeout=60.0)
        killed: list[float] = []

        def progress(share: float) -> None:
            if not killed:
                killed.append(time.monotonic())
                os.kill(own.process.pid, signal.SIGKILL)

        with pytest.raises(
            PlantFailure, match=r"(ticking|commands): the server is gone: .*, at t = "
        ) as caught:
            run(running(plant=plant, path=Circle(), duration=120.0), progress)
        assert time.monotonic() - killed[0] < 30.0  # its time-out is not waited for
        assert len(caught.value.episode) == 101  # told after the 100th step
        assert caught.value.episode.end == "error"
        assert caught.value.episode.meta["plant"] == "stand-in for CARLA 0.9.16"
        own.stop()


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGSTOP")
def test_a_slow_answer_is_waited_for_and_nothing_is_done_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(carla_steps, "_LOOK", 0.2)
    with serving() as own:
        session = config(own.port, timeout=20.0).session()
        session.open()
        try:
            first = session.tick().frame
            for k, ask in enumerate((session.tick, lambda: session.send([]))):
                os.kill(own.process.pid, signal.SIGSTOP)
                timer = threading.Timer(0.7, os.kill, (own.process.pid, signal.SIGCONT))
                timer.start()
                ask()
                timer.join()
                assert session.tick().frame == first + 2 + k
        finally:
            session.close()


# ---------------------------------------------------------------------------- configuration


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"dt": 0.2}, r"dt: 0\.2 s is not allowed; at most .* 0\.1 s"),
        ({"steering_delay": 0.03}, r"steering_delay: 0\.03 s is not allowed; a whole multiple"),
        ({"port": 0}, "port"),
        ({"prot": 2000}, "did you mean 'port'"),
    ],
)
def test_wrong_settings(words: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config(2000, **words) if "port" not in words else config(**words)


def test_a_dead_server_is_not_waited_for_when_leaving(monkeypatch: pytest.MonkeyPatch) -> None:
    server = carla_server.Server("127.0.0.1", 1, 60.0, 1)
    session = carla_session.Session(None, server, carla_session.Clock(0.05, 0.01, 10, True))
    called: list[str] = []
    session.client = SimpleNamespace(set_timeout=lambda _: called.append("asked"))
    begun = time.monotonic()
    session.close()
    assert time.monotonic() - begun < 5.0
    assert called == []
    with suppress(PlantError):
        session.close()


# ------------------------------------------------------------------------- a map of the server


def test_a_route_on_a_map_of_the_server(lib: Any, tmp_path: FilePath) -> None:
    """The server's map is fetched, a road of it is the path, and the same map is driven on."""
    maps = tmp_path / "maps"
    maps.mkdir()
    text = world_of(Circle(radius=60.0), 6.0)
    (maps / "Ring.xodr").write_text(text, encoding="utf-8")
    with serving("--maps", str(maps)) as own:
        plant = config(own.port, map="Ring")
        words = (f"plant.port={own.port}", "plant.map=Ring", "--to", str(tmp_path / "got.xodr"))
        CliRunner().invoke(app, ["carla", "map", *words], catch_exceptions=False)
        path = {"kind": "opendrive", "file": str(tmp_path / "got.xodr"), "road": "1"}
        speed = {"kind": "constant_speed", "speed": 8.0}
        words_of: dict[str, Any] = {"path": path, "speed": speed, "duration": 8.0}
        found = run(running(plant=plant, controller="pid", **words_of))
        assert found.end == "duration"
        world = lib.Client("127.0.0.1", own.port).get_world()
        assert world.get_map().name.endswith("Ring")  # it was not replaced
        message = r"Ring: at s = \d+ m the path is on no road of that map, the nearest lane is \d"
        with pytest.raises(PlantError, match=message):
            run(running(plant=plant, path=Circle(radius=50.0), duration=1.0))
        expected = run(running(controller="pid", **words_of))
        assert max(abs(found["x"] - expected["x"])) < 1e-3
