"""How a command ends: exit codes, and each error of the user's as one line on stderr."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import Any

import typer
from typer.core import TyperGroup

from steersman.cli.output import note
from steersman.errors import SteersmanError, how_to_install, one_line

USER_ERROR = 2
INTERRUPTED = 130
_LONGEST = 1000

# Typer carries a copy of click of its own since 0.22; either way this is the UsageError.
_UsageError: type[Any] = typer.BadParameter.__mro__[1]
# The extra of the package that brings an optional module.
_EXTRAS = {
    "carla": "carla",
    "jinja2": "report",
    "mcap": "logs",
    "minari": "minari",
    "PIL": "minari",
    "msgpack": "carla",
    "onnx": "export",
    "pyarrow": "bench",
    "ray": "ray",
    "rosbags": "logs",
    "optuna": "tune",
    "stable_baselines3": "train",
    "tensorboard": "train",
    "threadpoolctl": "train",
    "torch": "train",
}
# Commands whose settings are assignments, so that "--duration 5" deserves a hint.
_WITH_SETTINGS = frozenset({"compare", "drive", "train", "tune", "falsify", "demo"})


class OneLineGroup(TyperGroup):
    """A group of commands in which an error of the user's is one line and exit code 2."""

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Parse the arguments, run the command, and exit."""
        extra |= {"windows_expand_args": windows_expand_args}
        try:
            with _ended_as_interrupted():
                code = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        except _UsageError as error:
            code = fail(_usage(error))
        except SteersmanError as error:
            code = fail(str(error))
        except ModuleNotFoundError as error:
            code = fail(_missing(error))
        except (typer.Abort, KeyboardInterrupt):
            code = INTERRUPTED
        except OSError as error:
            if error.filename is None:
                raise
            code = fail(f"{error.filename}: {error.strerror}")
        sys.exit(code if isinstance(code, int) else 0)

    def format_commands(self, _: Any, formatter: Any) -> None:
        """List the commands with the whole first paragraph of their help."""
        texts = {name: command.help or "" for name, command in self.commands.items()}
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, one_line(text.partition("\n\n")[0])) for name, text in texts.items()]
            )


@contextmanager
def _ended_as_interrupted() -> Iterator[None]:
    """Take the end of a session (kill, a closed terminal) for a Ctrl-C: nothing driven is lost.

    Signals that are ignored, as under nohup, stay ignored.
    """
    numbers = [getattr(signal, name, None) for name in ("SIGTERM", "SIGHUP")]
    ours = [n for n in numbers if n is not None and signal.getsignal(n) is signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        ours = []
    for number in ours:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def fail(message: str, code: int = USER_ERROR) -> int:
    """Print the one line; the exit code that goes with it."""
    line = one_line(message)
    if len(line) > _LONGEST:  # what is wrong may stand behind a long name
        line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
    note(f"error: {line}")
    return code


@contextmanager
def goes_on(folder: str | None) -> Iterator[None]:
    """End a command that Ctrl-C stopped; with a folder, say that the same command goes on there.

    Raises:
        typer.Exit: Ctrl-C.
    """
    try:
        yield
    except KeyboardInterrupt:
        note("interrupted" + (f"; the same command goes on from {folder}" if folder else ""))
        raise typer.Exit(INTERRUPTED) from None


def interrupted(folder: FilePath, folders: Sequence[FilePath], goes_on: str) -> typer.Exit:
    """Say what became of a training, or of several, that Ctrl-C stopped; the end to raise.

    Args:
        folder: what the user named.
        folders: the folders of the trainings: it, or those in it.
        goes_on: where ``--resume`` would go on, where there is a checkpoint.
    """
    from steersman.learning import checkpoint

    if any(checkpoint.exists(each) for each in folders):
        rest = f"; --resume goes on from {goes_on} in {folder}"
    else:
        rest = f" before the first checkpoint: there is nothing to resume in {folder}"
    if any((each / "policy.onnx").exists() for each in folders):
        rest += "; the policy there is the best until the last validation"
    note(f"interrupted{rest}")
    return typer.Exit(INTERRUPTED)


def _usage(error: Any) -> str:
    """What is wrong with the words of a command, as one line in the manner of our own errors."""
    context, option = error.ctx, getattr(error, "option_name", None)
    possibilities = getattr(error, "possibilities", None)
    message, _, nearest = one_line(error.format_message()).rstrip(".").partition(". Did you mean ")
    message = message[:1].lower() + message[1:]
    if nearest:
        return f"{message}; did you mean {nearest}"
    if option and possibilities:
        return f"no such option: {option}; did you mean {' or '.join(possibilities)}?"
    if context is None:
        return message
    if option and "no such option" in message:
        letter = [o for p in context.command.params for o in p.opts if o.startswith(f"-{option}")]
        if letter and not option.startswith("--"):
            return f"{message}; did you mean {' or '.join(letter)}?"
        if context.info_name in _WITH_SETTINGS and option.startswith("--"):
            message += f"; settings are written key=value, like {option.lstrip('-')}=..."
    if "missing option" in message:
        name, param = context.info_name, error.param
        value = str(param.metavar).replace("FILE", name).replace("DIR", f"runs/{name}")
        message += f"; write {param.opts[0]} {value}"
    return f"{message}; see '{context.command_path} --help'"


def _missing(error: ModuleNotFoundError) -> str:
    """The line about a module of an extra that is not installed.

    Raises:
        ModuleNotFoundError: the module belongs to no extra, so that this is a fault of ours.
    """
    extra = _EXTRAS.get((error.name or "").partition(".")[0])
    if extra is None:
        raise error
    return f"{error.name}: not installed; this needs {how_to_install(extra)}"
