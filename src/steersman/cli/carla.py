"""``steersman carla``: what has to do with CARLA, its server and its stand-in."""

from __future__ import annotations

import sys
from pathlib import Path as FilePath
from typing import Annotated

import typer

from steersman.cli import carla_client
from steersman.cli.outcome import OneLineGroup
from steersman.cli.output import folded, write

SERVE_EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman carla serve\n"
    "  steersman carla serve --port 0 --vehicle my_car.yaml\n"
    "  steersman carla serve --maps ~/opendrive"
)


def serve(
    port: Annotated[
        int,
        typer.Option(
            "--port",
            min=0,
            max=65534,
            help="Port of the calls; streams are on the next. 0: the system chooses both.",
        ),
    ] = 2000,
    host: Annotated[str, typer.Option("--host", help="Address to listen on.")] = "127.0.0.1",
    vehicle: Annotated[
        str,
        typer.Option(
            "--vehicle",
            metavar="NAME|FILE.yaml",
            help="What drives as vehicle.tesla.model3: a vehicle by name, or a file.",
        ),
    ] = "carla_model3",
    maps: Annotated[
        str | None,
        typer.Option("--maps", metavar="DIR", help="Folder of *.xodr that can be loaded as maps."),
    ] = None,
) -> None:
    """Serve CARLA's protocol from the embedded simulator, until Ctrl-C.

    A stand-in for tests, teaching and CI of control clients: no GPU, no engine, and numbers that
    are the embedded simulator's, never CARLA's. Only what docs/carla_standin.md lists is answered.
    """
    import logging

    from carla_standin import StandinServer, models
    from carla_standin import serve as run
    from steersman.api.studies import vehicle_of

    logging.basicConfig(format="%(message)s")
    server = StandinServer(
        host,
        port,
        models(vehicle_of(vehicle)),
        None if maps is None else FilePath(maps).expanduser(),
    )

    def ready(server: StandinServer) -> None:
        line = (
            f"stand-in for a CARLA server: {server.host}:{server.port}, streams on "
            f"{server.stream_port}; vehicle.tesla.model3 is {vehicle}; Ctrl-C stops it"
        )
        write(f"{folded(line, sys.stdout)}\n")

    run(server, ready)
    write("stand-in: stopped\n")


app = typer.Typer(
    cls=OneLineGroup,
    rich_markup_mode=None,
    add_completion=False,
    help="CARLA: checks, calibration, a stand-in for its server.",
)
app.command("serve", epilog=SERVE_EXAMPLES)(serve)
app.command("doctor", epilog=carla_client.DOCTOR_EXAMPLES)(carla_client.doctor)
app.command("calibrate", epilog=carla_client.CALIBRATE_EXAMPLES)(carla_client.calibrate)
app.command("map", epilog=carla_client.MAP_EXAMPLES)(carla_client.fetch_map)
