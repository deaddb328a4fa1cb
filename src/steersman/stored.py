"""Base of the results that are kept as JSON: frozen models that are written and read back."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from steersman.bounds import MOST_JSON
from steersman.errors import DataError
from steersman.files import read_bytes, write_text
from steersman.shown import Shown


class StoredResult(BaseModel):
    """A result whose fields are the keys of its JSON object.

    A field that came later has a default, so that older files load; keys that are no fields are
    left out.
    """

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    def plain(self) -> dict[str, Any]:
        """The result as plain data for JSON."""
        return self.model_dump(mode="json")

    def write(self, file: FilePath) -> None:
        """Write the result as JSON.

        Raises:
            DataError: the file cannot be written.
        """
        write_text(file, json.dumps(self.plain(), indent=1, allow_nan=False) + "\n")

    @classmethod
    def read(cls, file: FilePath) -> Self:
        """The result that a file holds.

        Raises:
            DataError: the file is missing, not JSON, or of another form.
        """
        try:
            return cls.model_validate_json(read_bytes(file, "give a JSON file", MOST_JSON))
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise DataError(f"{file}: {f'{where}: ' * bool(where)}{first['msg']}") from None


def optional() -> Any:
    """A field that is None by default; the JSON object then lacks it."""
    return Field(None, exclude_if=lambda value: value is None)


class ShownResult(Shown, StoredResult):
    """A result that shows itself, and is saved whole as JSON."""

    def savers(self) -> Mapping[str, Callable[[FilePath], None]]:
        """``.json`` is the whole of it."""
        return {".json": self.write}


class SourcedResult(StoredResult):
    """A result with what made it."""

    versions: dict[str, str] = Field({})
    """Of Python and of the packages that matter for numbers."""
    commit: str | None = None
    """Of the source tree, if there was one."""
