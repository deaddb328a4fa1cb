"""Arguments and options that several commands have, each declared once."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import typer


def _completed(ctx: typer.Context, incomplete: str) -> list[str]:
    """Settings of a command, for a shell; nothing of it is imported otherwise."""
    from steersman.cli.completion import completed

    return completed(ctx.info_name or "", [*(ctx.params.get("words") or [])], incomplete)


def component(ctx: typer.Context, incomplete: str) -> list[str]:
    """A family of components, or after it one of them, for a shell."""
    from steersman.cli.completion import word_of

    return word_of(ctx.params.get("kind") or "", incomplete)


Words: TypeAlias = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[CONFIG.yaml] [key=value ...]",
        autocompletion=_completed,
        help="A YAML file, and settings over it; a setting of a part is written part.key=value.",
    ),
]
PresetWords: TypeAlias = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[PRESET | CONFIG.yaml] [key=value ...]",
        autocompletion=_completed,
        help="A training's preset or a YAML file, and settings over it.",
    ),
]
Out: TypeAlias = Annotated[
    str, typer.Option("--out", metavar="DIR", help="Folder for everything that is written.")
]
OptionalOut: TypeAlias = Annotated[
    str | None, typer.Option("--out", metavar="DIR", help="Write the results there.")
]
Overwrite: TypeAlias = Annotated[
    bool, typer.Option("--overwrite", help="Replace what an earlier run left in DIR.")
]
Resume: TypeAlias = Annotated[
    bool, typer.Option("--resume", help="Go on from the last checkpoint in DIR.")
]
Report: TypeAlias = Annotated[
    str | None,
    typer.Option("--report", metavar="FILE.html", help="Write a page with the plots."),
]
AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
# Options of all commands that run many jobs (steersman.engine).
Jobs: TypeAlias = Annotated[
    int | None, typer.Option("--jobs", min=1, help="Jobs at a time; by default one for each core.")
]
Engine: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--engine",
        metavar="local|ray",
        help="local: processes of this machine; ray: a cluster, the default if RAY_ADDRESS is set.",
    ),
]
