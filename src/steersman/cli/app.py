"""All commands put together. To add one: a module with its function, and a line here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from steersman.cli import (
    bench,
    carla,
    carla_client,
    compare,
    components,
    demo,
    drive,
    export,
    falsify,
    identify,
    imitate,
    path,
    report,
    reproduce,
    train,
    tune,
)
from steersman.cli.outcome import OneLineGroup
from steersman.cli.output import write

app = typer.Typer(
    cls=OneLineGroup,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # help is plain text: "[m]" would be taken for markup
    context_settings={"help_option_names": ["--help", "-h"]},
    epilog=(
        "\b\n"
        "Examples:\n"
        "  steersman list controller\n"
        "  steersman drive controller=mpc_pid path=circle path.radius=50 duration=60\n"
        "  steersman drive --help"
    ),
)
app.command("list", epilog=components.LIST_EXAMPLES)(components.list_components)
app.command("show", epilog=components.SHOW_EXAMPLES)(components.show_component)
app.command("drive", epilog=drive.EXAMPLES)(drive.drive)
app.command("train", epilog=train.EXAMPLES)(train.train)
app.command("imitate", epilog=imitate.EXAMPLES)(imitate.imitate)
app.command("demo", epilog=demo.EXAMPLES)(demo.demo)
app.command("tune", epilog=tune.EXAMPLES)(tune.tune)
app.command("falsify", epilog=falsify.EXAMPLES)(falsify.falsify)
app.command("bench", epilog=bench.EXAMPLES)(bench.bench)
app.command("export", epilog=export.EXAMPLES)(export.export)
app.command("identify", epilog=identify.EXAMPLES)(identify.identify)
app.command("compare", epilog=compare.EXAMPLES)(compare.compare)
app.command("reproduce", epilog=reproduce.EXAMPLES)(reproduce.reproduce)
app.command("report", epilog=report.EXAMPLES)(report.report)
paths = typer.Typer(
    rich_markup_mode=None, help="Paths and roads as OpenDRIVE.", epilog=path.GROUP_EXAMPLES
)
paths.command("export", epilog=path.EXAMPLES)(path.export)
paths.command("roads", epilog=path.ROADS_EXAMPLES)(path.roads)
app.add_typer(paths, name="path")
servers = typer.Typer(
    rich_markup_mode=None, help="CARLA: checks, calibration, a stand-in for its server."
)
servers.command("serve", epilog=carla.SERVE_EXAMPLES)(carla.serve)
servers.command("doctor", epilog=carla_client.DOCTOR_EXAMPLES)(carla_client.doctor)
servers.command("calibrate", epilog=carla_client.CALIBRATE_EXAMPLES)(carla_client.calibrate)
servers.command("map", epilog=carla_client.MAP_EXAMPLES)(carla_client.fetch_map)
app.add_typer(servers, name="carla")


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        write(f"steersman {version('steersman')}\n")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def steersman(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Train, drive and compare steering controllers that follow a path."""
    if context.invoked_subcommand is None:
        write(f"{context.get_help()}\n")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command ``steersman``."""
    app(args=arguments, prog_name="steersman")
