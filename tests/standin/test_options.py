"""What can be chosen on the command line, and what cannot."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path as FilePath

import pytest
from typer.testing import CliRunner

from steersman.cli import app
from steersman.vehicles import Bmw320i

from .reference import assert_same, commands, drive, embedded, start
from .serving import ROAD, Serving, connect, serving, spawn, synchronous


@pytest.fixture(scope="module")
def chosen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A server with another vehicle and a folder of maps."""
    folder = tmp_path_factory.mktemp("options")
    (folder / "Mine.xodr").write_text(ROAD, encoding="utf-8")
    (folder / "Bad.xodr").write_text("no map", encoding="utf-8")
    car = folder / "car.yaml"
    car.write_text("base: bmw_320i\nmass: 1200\n", encoding="utf-8")
    with serving("--maps", str(folder), "--vehicle", str(car)) as running:
        yield running


def test_another_vehicle_drives_behind_the_name(chosen: Serving) -> None:
    table = commands(60)
    world = synchronous(connect(chosen).get_world())
    car = spawn(world)
    states = embedded(Bmw320i(mass=1200.0), start(10.0, -20.0, 0.0), table, 5, 0.05)
    assert_same(drive(world, car, table), states)
    assert car.get_physics_control().mass == 1200.0


def test_maps_of_a_folder_can_be_loaded(chosen: Serving) -> None:
    client = connect(chosen)
    names = ["Carla/Maps/Bad", "Carla/Maps/Mine", "Carla/Maps/StandInStraight"]
    assert sorted(client.get_available_maps()) == names
    assert client.load_world("Mine").get_map().name == "Carla/Maps/Mine"
    assert client.load_world("Mine_Opt").get_map().name == "Carla/Maps/Mine_Opt"
    with pytest.raises(RuntimeError, match=r"stand-in: .*Mien.*did you mean 'Mine'"):
        client.load_world("Mien")
    with pytest.raises(RuntimeError, match=r"stand-in: .*OpenDRIVE: "):
        client.load_world("Bad")


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_a_terminated_server_stops_cleanly(chosen: Serving) -> None:
    code, said, faults = chosen.stop(signal.SIGTERM)
    assert (code, said) == (0, "stand-in: stopped\n")
    assert all(line.startswith("stand-in: ") for line in faults.splitlines())


def test_a_taken_port_is_said_in_one_line(server: Serving) -> None:
    done = CliRunner().invoke(app, ["carla", "serve", "--port", str(server.port)])
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.startswith("error: port ")
    assert done.stderr.endswith(
        " on 127.0.0.1 is taken; is a server running already? Choose another with --port\n"
    )


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--vehicle", "tesla"], "tesla"),
        (["--vehicle", "missing.yaml"], "missing.yaml"),
        (["--maps", "missing"], "missing: no such folder"),
        (["--maps", "."], "no *.xodr in it"),
        (["--host", "256.0.0.1"], "cannot be opened"),
        (["--port", "65536"], "--port"),
    ],
)
def test_wrong_options_are_said_in_one_line(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch, options: list[str], text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["carla", "serve", "--port", "0", *options])
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("error: ")
    assert text in done.stderr
