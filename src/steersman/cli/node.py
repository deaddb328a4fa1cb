"""``steersman node``: a controller that answers observations, from standard input or by UDP."""

from __future__ import annotations

import signal
import sys
from pathlib import Path as FilePath
from typing import Annotated

import typer

from steersman.cli.exported import loop_of
from steersman.cli.output import note
from steersman.errors import ConfigError

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman node tuned/lqr --stdin < observations.jsonl > commands.jsonl\n"
    "  steersman node supervised/tuned/mpc_delay --udp 127.0.0.1:5005 --deadline 0.01\n"
    "  steersman drive controller=process controller.command='[steersman, node, lqr, --stdin]'"
)


def node(
    run: Annotated[str, typer.Argument(metavar="CONTROLLER", help="What steers.")],
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[KEY=VALUE]...", help="Settings of a drive (nominal, plant.dt, sensor ...)."
        ),
    ] = None,
    stdin: Annotated[
        bool, typer.Option("--stdin", help="Read questions from standard input.")
    ] = False,
    udp: Annotated[
        str | None,
        typer.Option(
            "--udp", metavar="[HOST:]PORT", help="Or receive them by UDP; 0 takes a free port."
        ),
    ] = None,
    deadline: Annotated[
        float | None,
        typer.Option(
            "--deadline",
            min=0.0,
            metavar="SECONDS",
            help="From question to answer; else the control period.",
        ),
    ] = None,
    compiled: Annotated[
        bool, typer.Option("--compiled", help="Compile the controller's C code, and run that.")
    ] = False,
    count: Annotated[
        int | None, typer.Option("--count", min=1, help="End after so many datagrams.")
    ] = None,
    out: Annotated[
        str | None,
        typer.Option("--out", metavar="FILE", help="Write the statistics there, as JSON."),
    ] = None,
) -> None:
    """Answer observations with steering commands, as lines of JSON or as records.

    At the end of the input, or by Ctrl-C, statistics are printed on stderr: answers, times, missed
    deadlines, fallbacks.
    """
    if stdin == (udp is not None):
        raise ConfigError("give either --stdin or --udp")
    from steersman.controllers.estimated import in_front
    from steersman.delivery import serving
    from steersman.delivery.node import ControllerNode
    from steersman.delivery.observations import straight
    from steersman.files import write_text

    config, vehicle = loop_of(run, words or ())
    sensor, dt = config.sensor, config.plant.dt
    steers = whole = in_front(config.controller, config.estimator, config.predictor)
    if compiled:
        from steersman.delivery.compiled import compiled_controller
        from steersman.delivery.controller import Setting

        steers = compiled_controller(
            Setting("node", whole, vehicle, dt, sensor.count, sensor.spacing)
        )
    seen = straight(sensor.count, sensor.spacing)
    made = ControllerNode(steers, vehicle, dt, seen, deadline, gaps=whole.gaps)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        if udp is None:
            serving.serve_stream(made, sys.stdin.buffer, sys.stdout.buffer)
        else:
            with serving.bound(udp) as bound:
                host, port = bound.getsockname()
                note(f"listens on {host}:{port} (UDP); Ctrl-C ends it")
                if not host.startswith("127."):
                    note("any program that reaches it gets answers: no authentication")
                serving.serve_udp(made, bound, count)
    except KeyboardInterrupt:
        pass
    finally:
        statistics = made.statistics()
        note(statistics.sentence())
        if out is not None:
            write_text(FilePath(out), statistics.model_dump_json(indent=1) + "\n")
