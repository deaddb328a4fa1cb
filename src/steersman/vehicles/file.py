"""A vehicle from the user's own YAML file."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any, ClassVar

from pydantic import model_validator

from steersman.config import build, lookup, read_yaml, register, required
from steersman.errors import ConfigError
from steersman.vehicles.base import Vehicle


@register("vehicle", "file")
class VehicleFile(Vehicle):
    """A vehicle from the user's YAML file: ``base`` names a known kind, other keys replace it.

    Values given beside ``file`` in the configuration win over those in the file.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".yaml", ".yml")

    file: str = required("-", "YAML file with the vehicle's figures.")

    @property
    def title(self) -> str:
        """The file's name."""
        return FilePath(self.file).name

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "file" not in data:
            return data
        figures = read_yaml(FilePath(str(data["file"])))
        try:
            base = lookup("vehicle", str(figures.pop("base", "custom")))
            if base is cls:
                raise ConfigError("base must name a vehicle that is not a file")
            known = build(base, figures)
        except ConfigError as error:
            raise ConfigError(f"{data['file']}: {error}") from None
        return known.model_dump() | data
