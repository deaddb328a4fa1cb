"""``modelDescription.xml`` of an FMU, in versions 2.0 and 3.0 of the standard."""

from __future__ import annotations

import math
import re
from collections import Counter
from datetime import UTC, datetime
from importlib.metadata import version
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from steersman.delivery.fmu.model import INDEPENDENT, OUTPUT, PARAMETER, FmuModel, Variable

_BASE: dict[str, dict[str, int]] = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "-": {},
    "1": {},
}
_PART = re.compile(r"(kg|m|s|rad|N|-|1)(?:\^(\d))?")


def base_units(unit: str) -> dict[str, int] | None:
    """Exponents of the base units of a unit; None if it is none of mechanics.

    >>> base_units("N/rad")
    {'kg': 1, 'm': 1, 's': -2, 'rad': -1}
    """
    out: Counter[str] = Counter()
    for sign, side in zip((1, -1), unit.split("/", 1), strict=False):
        for word in side.split():
            found = _PART.fullmatch(word)
            if found is None:
                return None
            for name, power in _BASE[found[1]].items():
                out[name] += sign * power * int(found[2] or 1)
    return {name: power for name, power in out.items() if power}


def text_of(root: Element) -> str:
    """The document."""
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


def model_description(model: FmuModel, fmi: int, token: str) -> str:
    """The description for version 2 or 3."""
    two = fmi == 2  # noqa: PLR2004 - the version
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": model.title,
            "guid" if two else "instantiationToken": token,
            "description": "Signs by ISO 8855, SI units, steering in [-1, 1] with 1 to the left.",
            "generationTool": f"Steersman {version('steersman')}",
            "generationDateAndTime": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "variableNamingConvention": "structured",
        },
    )
    kind = SubElement(root, "CoSimulation", {"modelIdentifier": model.prefix})
    kind.set("canHandleVariableCommunicationStepSize", str(model.any_step).lower())
    kind.set("canGetAndSetFMUstate" if two else "canGetAndSetFMUState", "true")
    if two:
        kind.set("canNotUseMemoryManagementFunctions", "true")
        files = SubElement(kind, "SourceFiles")
        for name in compiled_files(model, fmi):
            SubElement(files, "File", {"name": name})
    else:
        kind.set("fixedInternalStepSize", repr(model.period))
    _units(root, model)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", {"name": "logStatusError"})
    SubElement(root, "DefaultExperiment", {"startTime": "0.0", "stepSize": repr(model.period)})
    variables = SubElement(root, "ModelVariables")
    for i, each in enumerate(model.variables):
        (_variable2 if two else _variable3)(variables, i, each)
    _structure(root, model, two=two)
    return text_of(root)


def compiled_files(model: FmuModel, fmi: int) -> list[str]:
    """The sources that make the binary."""
    return [f"fmi{fmi}.c", *(name for name in model.sources if name.endswith(".c"))]


def build_description(model: FmuModel, fmi: int) -> str:
    """``buildDescription.xml`` of FMI 3, which lists the sources."""
    root = Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = SubElement(root, "BuildConfiguration", {"modelIdentifier": model.prefix})
    files = SubElement(configuration, "SourceFileSet", {"language": "C99"})
    for name in compiled_files(model, fmi):
        SubElement(files, "SourceFile", {"name": name})
    SubElement(configuration, "Library", {"name": "m", "external": "true"})
    return text_of(root)


def _units(root: Element, model: FmuModel) -> None:
    units = dict.fromkeys(each.unit for each in model.variables if not each.whole)
    definitions = SubElement(root, "UnitDefinitions")
    for unit in units:
        if unit != "-":
            one, base = SubElement(definitions, "Unit", {"name": unit}), base_units(unit)
            if base is not None:
                SubElement(one, "BaseUnit", {k: str(v) for k, v in base.items()})


def _about(each: Variable, reference: int) -> dict[str, str]:
    out = {"name": each.name, "valueReference": str(reference), "causality": each.causality}
    if each.meaning:
        out["description"] = each.meaning
    if each.causality == PARAMETER:
        out["variability"] = "tunable"
    elif each.causality == INDEPENDENT:
        out["variability"] = "continuous"
    elif each.whole:
        out["variability"] = "discrete"
    return out


def _numbers(each: Variable) -> dict[str, str]:
    """Unit, limits and start value."""
    out = {} if each.whole or each.unit == "-" else {"unit": each.unit}
    if math.isfinite(each.low):
        out["min"] = repr(each.low)
    if math.isfinite(each.high):
        out["max"] = repr(each.high)
    if each.causality not in {OUTPUT, INDEPENDENT}:
        out["start"] = str(int(each.start)) if each.whole else repr(each.start)
    return out


def _variable2(parent: Element, i: int, each: Variable) -> None:
    variable = SubElement(parent, "ScalarVariable", _about(each, i))
    SubElement(variable, "Integer" if each.whole else "Real", _numbers(each))


def _variable3(parent: Element, i: int, each: Variable) -> None:
    SubElement(parent, "Int32" if each.whole else "Float64", _about(each, i) | _numbers(each))


def _structure(root: Element, model: FmuModel, *, two: bool) -> None:
    structure = SubElement(root, "ModelStructure")
    outputs = [i for i, each in enumerate(model.variables) if each.causality == OUTPUT]
    if two:
        for name in ("Outputs", "InitialUnknowns"):
            parent = SubElement(structure, name)
            for i in outputs:
                # No output changes with an input before the next step.
                SubElement(parent, "Unknown", {"index": str(i + 1), "dependencies": ""})
        return
    for name in ("Output", "InitialUnknown"):
        for i in outputs:
            SubElement(structure, name, {"valueReference": str(i), "dependencies": ""})
