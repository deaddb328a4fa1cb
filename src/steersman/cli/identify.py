"""``steersman identify``: a vehicle file out of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from steersman.cli import settings
from steersman.cli.output import note, show, show_json, table

if TYPE_CHECKING:
    from steersman.studies.identify.identification import Identified

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman identify drive.csv --out car.yaml\n"
    "  steersman identify runs/log --vehicle bmw_320i --out car.yaml --report fit.html\n"
    "  steersman identify drive.csv --lock 8.2 --out car.yaml   # steering wheel's angle\n"
    "  steersman identify a.csv b.csv --columns carla --out car.yaml   # logs of a CARLA client\n"
    "  steersman identify drive.mcap --ahead 1.4 --out car.yaml\n"
    "\n"
    "Then: steersman drive vehicle=file vehicle.file=car.yaml"
)


def identify(  # noqa: PLR0913, PLR0917 - an argument is an option of the command
    log: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG...",
            help="CSV files, MCAP files or ROS 2 bags, or folders of drive --out, of one car.",
        ),
    ],
    vehicle: Annotated[
        str,
        typer.Option("--vehicle", metavar="NAME|FILE.yaml", help="The vehicle to start from."),
    ] = "carla_model3",
    out: Annotated[
        str | None, typer.Option("--out", metavar="FILE.yaml", help="The vehicle file to write.")
    ] = None,
    page: settings.Report = None,
    columns: Annotated[
        str | None,
        typer.Option(
            "--columns",
            metavar="SIGNAL=TITLE,...|carla",
            help="Columns of a CSV file: time=t,v_x_km_h=v,yaw_rate=-r,brake=p/90.",
        ),
    ] = None,
    holdout: Annotated[
        float,
        typer.Option(
            "--holdout", min=0.0, max=0.5, help="Share that only judges the fit; 0: none."
        ),
    ] = 0.25,
    last: Annotated[
        bool, typer.Option("--last", help="Hold the end out, instead of blocks all over.")
    ] = False,
    lock: Annotated[
        float | None,
        typer.Option("--lock", help="Angle of steer_angle at full lock [rad]."),
    ] = None,
    ahead: Annotated[
        float,
        typer.Option("--ahead", help="Centre of mass ahead of the recorded point [m] (MCAP)."),
    ] = 0.0,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    as_json: settings.AsJson = False,
) -> None:
    """Fit a vehicle to a recording.

    Steering delay, lag, rates, ratio and bias, both axles' cornering stiffnesses, yaw inertia,
    throttle map and brakes, each with a 95 % interval. What the recording does not tell is kept
    from the vehicle that it starts from, and said.
    """
    import steersman as sm
    from steersman.files import HTML, out_file
    from steersman.studies.identify.result import plain
    from steersman.words import YAML

    file = None if out is None else out_file(out, "--out", YAML)
    shown = None if page is None else out_file(page, "--report", HTML)
    found = sm.identify(
        log,
        vehicle,
        columns=columns,
        holdout=holdout,
        last=last,
        lock=lock,
        ahead=ahead,
        out=file,
        notify=note,
        engine=engine,
        jobs=jobs,
    )
    if shown is not None:
        from steersman.report.identification import write_identification

        write_identification(found, shown)
    if as_json:
        show_json(plain(found))
    else:
        _show(found, out, page)


def _show(found: Identified, out: str | None, page: str | None) -> None:
    from steersman.studies.identify.identification import SEEN
    from steersman.studies.identify.result import described

    figures = table("figure", "unit", "before", "now", "95 % interval", right=("before", "now"))
    kept = []
    for f in found.figures:
        if f.name.startswith("map_acceleration"):
            continue
        if f.low is None and f.status != SEEN:
            kept.append(f)
        else:
            figures.add_row(f.name, f.unit, f"{f.before:.4g}", f"{f.value:.4g}", described(f))
    heads = ("before", "now", "white noise")
    errors = table("1 s predicted", "unit", *heads, right=heads)
    for e in found.errors:
        errors.add_row(e.signal, e.unit, f"{e.before:.3g}", f"{e.after:.3g}", f"{e.noise:.2g}")
    items: list[Any] = [
        f"{found.seconds:.0f} s of {found.log.name} fitted, from {found.before.title}"
    ]
    items += [f"left out: {left.seconds:.1f} s {left.reason}" for left in found.left_out]
    items += ["", figures]
    told = _kept(kept)
    if told:
        items += ["", "kept as they were; the recording does not determine them:", told]
    if any(f.name.startswith("map_acceleration") for f in found.figures):
        items += ["", *_map(found)]
    else:
        items += ["", "throttle map and brakes: kept; the recording has no throttle"]
    if found.errors:
        told = "RMS error of predictions over 1 s, on what was held out, sensor noise included"
        items += ["", errors, f"\n{told}"]
    items += [f"written to {name}" for name in (out, page) if name]
    if any(f.name == "steer_delay" and f.low is not None for f in found.figures):
        items.append("steer_delay holds any offset between the clocks of commands and sensors")
    show(*items)


def _map(found: Identified) -> list[Any]:
    """The throttle map, and how many of its knots the recording determines."""
    vehicle = found.vehicle
    speeds = [f"{v:.3g} m/s" for v in vehicle.map_speed]
    grid = table("throttle", *speeds, right=("throttle", *speeds))
    told = {f.name: f for f in found.figures if f.low is not None and f.high is not None}
    halves = []
    for i, (level, row) in enumerate(
        zip(vehicle.map_throttle, vehicle.map_acceleration, strict=True)
    ):
        cells = []
        for j, value in enumerate(row):
            figure = told.get(f"map_acceleration[{i}][{j}]")
            cells.append(f"{value:.2f}" if figure else "kept")
            if figure is not None and figure.low is not None and figure.high is not None:
                halves.append(0.5 * (figure.high - figure.low))
        grid.add_row(f"{level:g}", *cells)
    middle = f", to +-{sorted(halves)[len(halves) // 2]:.2g} in the middle" if halves else ""
    return [
        "net acceleration on a straight [m/s^2], drag included:",
        grid,
        f"{len(halves)} knots determined{middle}; all intervals are in the file and in --json",
    ]


def _kept(figures: list[Any]) -> str:
    """Lines of the figures that are kept; those of a map by their reasons."""
    lines: dict[str, list[str]] = {}
    for f in figures:
        lines.setdefault(f"{f.status}: {f.note}" if f.note else f.status, []).append(f.name)
    return "\n".join(f"  {', '.join(names)} ({why})" for why, names in lines.items())
