"""``steersman adopt``: a network trained elsewhere as a controller."""

from __future__ import annotations

from typing import Annotated

import typer

from steersman.cli import settings
from steersman.cli.output import note, write

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman adopt ours.zip --out adopted    (trained in steersman/PathFollowing-v0)\n"
    "  steersman adopt model.zip --encoding waypoints --out adopted\n"
    "  steersman adopt model.zip --encoding list \\\n"
    "      encoding.features=[lateral_error,heading_error,v_x] \\\n"
    "      scale=[1,57.3,0.1] --limits 1,-1 --out adopted\n"
    "  steersman adopt network.onnx --encoding extended action=rate dt=0.02 --out adopted\n"
    "  steersman drive adopted/policy.onnx path=monza"
)

_OTHERS = "features, their order, units (scale), signs (--limits 1,-1) or dt may be others"
_ELSE = (
    "it reads what it was trained with in steersman/PathFollowing-v0; so it is not trained far"
    " enough, or a wrapper (VecNormalize) changed what it read"
)


def adopt(
    model: Annotated[
        str,
        typer.Argument(metavar="MODEL", help="A .zip of Stable-Baselines3, or an .onnx file."),
    ],
    out: settings.Out,
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[KEY=VALUE]...",
            help="encoding.FIELD, scale, action, rate_limit, output, dt [s], spacing [m].",
        ),
    ] = None,
    encoding: Annotated[
        str | None,
        typer.Option("--encoding", metavar="NAME", help="What it reads; as encoding=NAME."),
    ] = None,
    limits: Annotated[
        str | None,
        typer.Option(
            "--limits",
            metavar="LOW,HIGH",
            help="Steering (1: full lock left) at the bounds of its action; else -1,1.",
        ),
    ] = None,
) -> None:
    """Make a controller from a network that was trained elsewhere, and try it.

    MODEL is never unpickled: of a .zip (DDPG, TD3, SAC, PPO or A2C with MlpPolicy) the tensors are
    read, an .onnx file may hold layers alone. Writes policy.onnx and its card policy.json. The
    check drive shows whether features, units and signs are those of its training. Models that were
    trained in steersman/PathFollowing-v0 say what they read.
    """
    from steersman.api.adopting import adopt as make

    given = {"encoding": encoding, "limits": limits and f"[{limits}]"}
    more = [f"{key}={value}" for key, value in given.items() if value is not None]
    made = make(model, *more, *(words or []), out=out)
    note(str(made))
    if not made.episode.completed:
        note(_ELSE if made.described else _OTHERS)
    write(f"{made.file}\n")
