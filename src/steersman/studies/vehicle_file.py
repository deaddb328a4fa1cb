"""A vehicle as a file that ``vehicle=file vehicle.file=...`` reads, with what is known of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman import core_yaml
from steersman.files import write_text
from steersman.vehicles import Vehicle


def write_vehicle(
    vehicle: Vehicle, file: FilePath, head: Sequence[str], marks: Mapping[str, str] | None = None
) -> None:
    """Write all figures, so that the file means the same whatever built-in vehicles become.

    Args:
        vehicle: the figures.
        file: what to write.
        head: lines of the comment above.
        marks: field -> comment behind it.

    Raises:
        DataError: it cannot be written.
    """
    figures: dict[str, Any] = {"base": "custom", **vehicle.model_dump(mode="json")}
    figures.pop("file", None)
    lines = [f"# {line}" for line in head]
    for line in core_yaml.dump(figures).splitlines():
        mark = (marks or {}).get(line.partition(":")[0])
        lines.append(f"{line}  # {mark}" if mark else line)
    write_text(file, "\n".join(lines) + "\n")
