"""Write a controller as C with its card and its table of parameters; read the table back."""

from __future__ import annotations

import csv
import json
import math
import tempfile
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path as FilePath

from steersman.config import dump
from steersman.controllers.policy import Policy
from steersman.delivery import controller_text as text
from steersman.delivery import vector_text
from steersman.delivery.c_text import identifier
from steersman.delivery.controller import Setting, Translated, translated
from steersman.delivery.measuring import measured
from steersman.delivery.package import Tell, try_out, unsaid
from steersman.delivery.parameter_table import COLUMNS, entries, table_text
from steersman.errors import DataError, suggestion
from steersman.files import replacing, write_text
from steersman.kernels import active_set
from steersman.policy_file import PolicyCard, sha256
from steersman.provenance import provenance

# Names in a sentence.
_NAMED = 8


def prepared(setting: Setting, tell: Tell) -> tuple[Translated, dict[str, str]]:
    """A controller in C, with its source and header by the names of their files.

    ``tell`` gets sentences on its parameters.

    Raises:
        ConfigError: its Python holds what C cannot be made of.
        DataError: a number of the design that was given is none of its own.
    """
    made = translated(setting)
    check_values(made)
    tell_parameters(made, tell)
    return made, text.sources(made)


def check_float(setting: Setting) -> None:
    """Where there is a C compiler, refuse a controller that its test vector shows too coarse.

    Raises:
        DataError: its answers in C are not those of Python.
    """
    with tempfile.TemporaryDirectory() as scratch:
        try_out(write_controller(setting, FilePath(scratch))[0])


def write_controller(
    setting: Setting, folder: FilePath, tell: Tell = unsaid, *, measure: bool = False
) -> Sequence[FilePath]:
    """The controller as C99: source, header, test vector and its program, parameters, card.

    ``tell`` gets sentences on its parameters. ``measure``: the card gets what
    :func:`~steersman.delivery.measuring.measured` finds.

    Raises:
        ConfigError: its Python holds what C cannot be made of.
        DataError: a number of the design that was given is none of its own.
    """
    made, sources = prepared(setting, tell)
    name = identifier(setting.name)
    makefile = files("steersman.delivery.templates").joinpath("Makefile.in")
    with vector_text.counted_steps() as steps:
        vector = vector_text.vector(made)
    contents: dict[str, str | bytes] = {
        **sources,
        f"test_{name}.c": vector_text.program(made),
        f"vector_{name}.h": vector,
        f"{name}.csv": table_text(made),
        "Makefile": makefile.read_text(encoding="utf-8"),
    }
    if isinstance(setting.controller, Policy):
        contents[f"{name}.onnx"] = setting.controller.read()[0]
    for each, content in contents.items():
        with replacing(folder / each) as stream:
            stream.write(_bytes(content))
    costs = measured(setting, folder, tell, solves=bool(steps)) if measure else {}
    write_text(folder / f"{name}.json", controller_card(made, contents, steps, costs))
    return [folder / each for each in (*contents, f"{name}.json")]


def _bytes(content: str | bytes) -> bytes:
    return content if isinstance(content, bytes) else content.encode()


def controller_card(
    made: Translated,
    contents: Mapping[str, str | bytes],
    steps: Sequence[int] = (),
    costs: Mapping[str, object] | None = None,
) -> str:
    """What a controller in C was made from, with the SHA-256 of its files, as JSON.

    Of a policy it is the policy's own card with all of that in ``made_for``. ``steps`` are those of
    the quadratic programs that Python solved for the test vector, ``costs`` what was measured.
    """
    s = made.setting
    programs = {
        "most_steps": active_set.MOST_STEPS,
        "largest_in_test_vector": max(steps, default=0),
    }
    digests = {name: sha256(_bytes(content)) for name, content in contents.items()}
    card = {
        "name": s.name,
        "controller": dump(s.controller),
        "vehicle": dump(s.vehicle),
        "dt": s.dt,
        "waypoints": s.waypoints,
        "spacing": s.spacing,
        "precision": s.precision,
        "constant_parameters": sorted(made.program.pinned),
        **({"quadratic_programs": programs} if steps else {}),
        **(costs or {}),
        **provenance(),
    }
    if isinstance(s.controller, Policy):
        policy = s.controller.read()[1]
        limits = {**policy.limits, **_limits(s.controller, policy)}
        policy = policy.model_copy(update={"files": digests, "limits": limits, "made_for": card})
        return policy.model_dump_json(indent=1) + "\n"
    card["files"] = digests
    return json.dumps(card, indent=1) + "\n"


def _limits(policy: Policy, card: PolicyCard) -> dict[str, list[float]]:
    """What is bounded beside action and steering."""
    speed, shift = policy.trim_speed, policy.trim_limit
    out = {"path shift [m]": [-shift, shift], "its speed [m/s]": [-speed, speed]}
    if card.rate_limit is not None:
        out["steer rate [1/s]"] = [-card.rate_limit, card.rate_limit]
    return out


def check_values(made: Translated) -> None:
    """Refuse numbers of the design that the controller does not have, or that it does not allow.

    Raises:
        DataError: there is one.
    """
    known = {each.name: each for each in entries(made)}
    for name, value in made.setting.values.items():
        if name not in known:
            raise DataError(f"parameter {name!r}: unknown{suggestion(name, known)}")
        one = known[name]
        if not one.minimum <= value <= one.maximum:
            low, high = one.limits
            ends = " and ".join(f"{sign}{end}" for sign, end in _bounds(low, high))
            raise DataError(
                f"parameter {name!r}: {value:g} is not allowed; must be {ends} [{one.unit}]:"
                f" {one.meaning}"
            )


def _bounds(low: str, high: str) -> list[tuple[str, str]]:
    """The limits of a table that there are, each with its sign."""
    ends = (("> ", ">= ", low, ">"), ("< ", "<= ", high, "<"))
    return [(strict if end[0] == sign else closed, end.lstrip(sign))
            for strict, closed, end, sign in ends if end]  # fmt: skip


def tell_parameters(made: Translated, tell: Tell) -> None:
    """Say how many parameters can change without compiling, and which of them a table lacks."""
    known, given = [each.name for each in entries(made)], made.setting.table
    plural = "" if len(known) == 1 else "s"
    tell(f"{len(known)} parameter{plural} can be changed without compiling")
    if made.design_settings:
        names = _listed(made.design_settings)
        tell(f"constant, for the design is made of them: {names}; export anew to change them")
    missing = [each for each in known if given and each not in given]
    if missing:
        tell(f"not in the table, kept: {_listed(missing)}")


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def read_table(file: FilePath) -> dict[str, float]:
    """Names and values of a table of parameters, as it was written or changed.

    Raises:
        DataError: it is missing, or no such table.
    """
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            reader = csv.reader(stream)
            rows = [(reader.line_num, cells) for cells in reader if cells]
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{file}: cannot be read: {error}") from None
    columns = rows[0][1] if rows else []
    if {"name", "value"} <= set(";".join(columns).split(";")) and "name" not in columns:
        raise DataError(f"{file}: its cells are separated by ';'; expected ',' and decimal points")
    if len(rows) < 2 or not {"name", "value"} <= set(columns):  # noqa: PLR2004 - names and a row
        raise DataError(f"{file}: expected a table with the columns {', '.join(COLUMNS)}")
    out = {}
    for line, cells in rows[1:]:
        row = dict(zip(columns, cells, strict=False))
        if len(cells) != len(columns):
            name = row.get("name", "?")
            what = f"{len(cells)} cells, expected {len(columns)}; decimals need a point"
            raise DataError(f"{file}: line {line} ({name}): {what}")
        try:
            out[row["name"]] = float(row["value"])
        except ValueError:
            what = f"value {row['value']!r}, expected a number"
            raise DataError(f"{file}: line {line}: {what}") from None
        if not math.isfinite(out[row["name"]]):
            raise DataError(f"{file}: line {line}: value {row['value']}, expected a finite number")
    return out
