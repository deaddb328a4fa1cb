"""Write an FMU: description, sources, resources, and the binary of this platform."""

from __future__ import annotations

import hashlib
import platform
import sys
import uuid
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path as FilePath

from steersman.delivery import c_text
from steersman.delivery.compiled import FLAGS, shared_library
from steersman.delivery.fmu.description import build_description, compiled_files, model_description
from steersman.delivery.fmu.model import INPUT, OUTPUT, PARAMETER, FmuModel
from steersman.errors import ConfigError
from steersman.files import replacing

VERSIONS = (2, 3)
# System as Python calls it: as FMI 2 and FMI 3 do, and what a library ends in.
_SYSTEMS = {
    "linux": ("linux", "linux", ".so"),
    "darwin": ("darwin", "darwin", ".dylib"),
    "win32": ("win", "windows", ".dll"),
}
_PROCESSORS = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}


def write_fmu(
    model: FmuModel, fmi: int, folder: FilePath, tell: Callable[[str], object]
) -> list[FilePath]:
    """``NAME.fmu`` of version 2 or 3; ``tell`` gets a sentence if it has no binary."""
    name = c_text.identifier(model.title)
    sources = {
        **model.sources,
        "fmu_model.h": c_text.fill("fmu_model.h.in", _words(model)),
    }
    digest = hashlib.sha256(repr((sources, model.variables, fmi)).encode()).digest()
    token = f"{{{uuid.UUID(bytes=digest[:16], version=4)}}}"
    state = "state" if fmi == VERSIONS[0] else "State"
    same = {"version": fmi, "prefix": model.prefix, "state": state}
    sources["fmi.h"] = c_text.fill("fmi.h.in", same)
    words = {"title": c_text.comment(model.title), "token": token}
    sources[f"fmi{fmi}.c"] = c_text.fill(f"fmi{fmi}.c.in", words)
    contents: dict[str, bytes] = {
        "modelDescription.xml": model_description(model, fmi, token).encode(),
        **{f"resources/{each}": text.encode() for each, text in model.resources.items()},
        **{f"sources/{each}": text.encode() for each, text in sources.items()},
    }
    if fmi != VERSIONS[0]:
        contents["sources/buildDescription.xml"] = build_description(model, fmi).encode()
    place, suffix = binary_place(fmi)
    if place:
        try:
            binary = shared_library(sources, compiled_files(model, fmi), FLAGS)
        except ConfigError as error:
            tell(f"no binary in the FMU: {error}; sources/ can be compiled elsewhere")
        else:
            contents[f"binaries/{place}/{model.prefix}{suffix}"] = binary
            tell(f"FMI {fmi}.0 for co-simulation: {_counts(model)}; sources, binary for {place}")
    else:
        tell(f"no binary in the FMU: FMI {fmi}.0 has no name for this platform; compile sources/")
    file = folder / f"{name}.fmu"
    with replacing(file) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in contents.items():
            archive.writestr(path, data)
    return [file]


def _counts(model: FmuModel) -> str:
    counts = ((len(model.those(each)), each) for each in (INPUT, OUTPUT, PARAMETER))
    return ", ".join(f"{count} {each}{'s' * (count != 1)}" for count, each in counts)


def binary_place(fmi: int) -> tuple[str, str]:
    """The folder of this platform's binaries, empty if it has none, and how a library ends."""
    two, three, suffix = _SYSTEMS.get(sys.platform, ("", "", ".so"))
    processor = _PROCESSORS.get(platform.machine().lower(), "")
    if fmi == VERSIONS[0]:
        return (f"{two}64" if two and processor == "x86_64" else ""), suffix
    return (f"{processor}-{three}" if three and processor else ""), suffix


def _words(model: FmuModel) -> dict[str, object]:
    parameters = len(model.those(PARAMETER))
    first = len(model.variables) - parameters - 1
    renew = ["(void)m;"]
    if model.parameters:
        renew = [
            f"{model.real} *const to = ({model.real} *)&m->parameters;",
            "int i;",
            "",
            f"for (i = 0; i < {parameters}; ++i) {{",
            f"    to[i] = ({model.real})m->value[FIRST_PARAMETER + i];",
            "}",
            "m->state.parameters = &m->parameters;",
        ]
    return {
        "title": c_text.comment(model.title),
        "prefix": model.prefix,
        "values": len(model.variables),
        "first_parameter": first,
        "period": repr(model.period),
        "period_plain": f"{model.period:g}",
        "started": "".join(f"    {each.start!r},\n" for each in model.variables),
        "lowest": "".join(f"    {_limit(each.low)},\n" for each in model.variables),
        "highest": "".join(f"    {_limit(each.high)},\n" for each in model.variables),
        "whole": "".join(f"    {int(each.whole)},\n" for each in model.variables),
        "parameters_field": f"    {model.parameters} parameters;\n" if model.parameters else "",
        "renew": _block(renew),
        "begin": _block(model.lines["begin"]),
        "advance": _block(model.lines["advance"]),
        "step_check": "" if model.any_step else _STEP_CHECK.replace("PLAIN", f"{model.period:g}"),
    }


_STEP_CHECK = """\
    if (fabs(count - floor(count + 0.5)) * PERIOD > SAME) {
        return "the communication step has to be a whole multiple of PLAIN s";
    }
"""


def _limit(value: float) -> str:
    return repr(value).replace("inf", "INFINITY")


def _block(lines: Iterable[str]) -> str:
    return "".join(f"    {each}\n" if each else "\n" for each in lines)
