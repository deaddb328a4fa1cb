"""All commands put together. To add one: a module with its function, and a line in the table."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, MutableMapping, Sequence
from typing import Annotated, Any, NamedTuple

import typer

from steersman.cli.outcome import OneLineGroup
from steersman.cli.output import write


class Entry(NamedTuple):
    """A command, or a group of them (a ``typer.Typer``), in a module of its own."""

    place: str
    """``module:name`` of the function, or of the group."""
    help: str
    """The first line of its help, so that the list of commands imports none of them."""
    examples: str = "EXAMPLES"
    """Name of the text that ends its help, in the same module."""


# In the order of ``steersman --help``.
COMMANDS = {
    "list": Entry(
        "components:list_components",
        "List the components that can be named in a configuration.",
        "LIST_EXAMPLES",
    ),
    "show": Entry(
        "components:show_component",
        "Show the fields of a component, or all settings of a command.",
        "SHOW_EXAMPLES",
    ),
    "check": Entry(
        "components:check_component",
        "Check a component against the contract of its family.",
        "CHECK_EXAMPLES",
    ),
    "drive": Entry("drive:drive", "Drive one closed loop and print what was measured."),
    "live": Entry("live:live", "Choose on a page what to drive; every change drives again."),
    "train": Entry("train:train", "Train an agent and export its policy."),
    "search": Entry("search:search", "Search the hyper-parameters of a training with Optuna."),
    "imitate": Entry(
        "imitate:imitate",
        "Fit a network to a controller's actions, by DAgger or behaviour cloning.",
    ),
    "demo": Entry("demo:demo", "Train an agent and compare it with classical controllers."),
    "tune": Entry("tune:tune", "Tune a controller's gains with Optuna on a suite of runs."),
    "falsify": Entry(
        "falsify:falsify",
        "Search for the mildest disturbance that takes a controller off the road.",
    ),
    "bench": Entry(
        "bench:bench", "Drive every controller through the same scenarios, and compare them."
    ),
    "export": Entry(
        "export:export", "Write a result in another format: C, FMU, ROS 2, ONNX, MCAP, Minari."
    ),
    "adopt": Entry("adopt:adopt", "Make a controller from a network that was trained elsewhere."),
    "node": Entry("node:node", "Answer observations with steering, from standard input or by UDP."),
    "identify": Entry("identify:identify", "Fit a vehicle to a recording."),
    "compare": Entry(
        "compare:compare", "Set drives, trainings, benchmarks or controllers side by side."
    ),
    "reproduce": Entry("reproduce:reproduce", "Run the paper's experiments beside its figures."),
    "report": Entry("report:report", "Make one HTML page of tables and plots."),
    "version": Entry("version:version", "Print versions, commit and installed extras."),
    "path": Entry("path:app", "Paths and roads as OpenDRIVE."),
    "carla": Entry("carla:app", "CARLA: checks, calibration, a stand-in for its server."),
}


class _Commands(MutableMapping[str, Any]):
    """The commands by name, each imported at its first use."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            self._made[name] = _command(name, COMMANDS[name])
        return self._made[name]

    def __setitem__(self, name: str, command: Any) -> None:
        self._made[name] = command

    def __delitem__(self, name: str) -> None:
        del self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


def _command(name: str, entry: Entry) -> Any:
    module, _, attribute = entry.place.partition(":")
    source = importlib.import_module(f"steersman.cli.{module}")
    found = getattr(source, attribute)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(rich_markup_mode=None, add_completion=False)
        alone.command(name, epilog=getattr(source, entry.examples))(found)
        found = alone
    made = typer.main.get_command(found)
    made.name = name
    return made


class LazyGroup(OneLineGroup):
    """The root of the command line: its commands are imported when they are used."""

    def __init__(self, **words: Any) -> None:
        """As typer makes it."""
        super().__init__(**{**words, "commands": None})
        self.commands = _Commands()

    def format_commands(self, _: Any, formatter: Any) -> None:
        """List the commands from the table, without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.help) for name, entry in COMMANDS.items()])


app = typer.Typer(
    cls=LazyGroup,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # help is plain text: "[m]" would be taken for markup
    context_settings={"help_option_names": ["--help", "-h"]},
    epilog=(
        "\b\n"
        "Examples:\n"
        "  steersman list controller\n"
        "  steersman drive tuned/lqr path=circle path.radius=50 duration=60\n"
        "  steersman drive --help"
    ),
)


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
