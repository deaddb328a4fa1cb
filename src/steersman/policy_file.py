"""The card that travels with an exported policy: what it must be fed and what it answers."""

from __future__ import annotations

import hashlib
import json
from importlib.resources import files
from pathlib import Path as FilePath
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from steersman.errors import DataError, suggestion
from steersman.messages import config_error

FORMAT = 1


class PolicyCard(BaseModel):
    """Everything needed to run ``policy.onnx``; written beside it as ``policy.json``."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    format: int = FORMAT
    sha256: str
    action: str
    rate_limit: float | None
    """Largest rate of normalised steering [1/s] if the action is ``rate``, else null."""
    base: dict[str, Any] | None = None
    """Controller whose steering the action corrects if it is ``residual``, else null."""
    authority: float | None = Field(default=None, gt=0)
    """Largest correction of normalised steering, else null."""
    dt: float = Field(gt=0)
    waypoints: int = Field(ge=0)
    spacing: float = Field(gt=0)
    trim: float = Field(default=0.0, ge=0)
    """Rate of the integral loop around the network [1/s]."""
    encoding: dict[str, Any]
    observation: list[str]
    scale: list[float]
    units: dict[str, str]
    limits: dict[str, list[float]]
    seed: int
    training: dict[str, Any]
    versions: dict[str, str]
    commit: str | None

    @model_validator(mode="after")
    def _whole(self) -> PolicyCard:
        if (self.base is None) != (self.authority is None):
            raise ValueError("base and authority go together")
        if self.base is not None and self.rate_limit is not None:
            raise ValueError("rate_limit: a correction of the base has none")
        return self


def sha256(data: bytes) -> str:
    """Hex digest of a file's content."""
    return hashlib.sha256(data).hexdigest()


def shipped() -> list[str]:
    """Names of the policies that are part of the package."""
    found = files("steersman.policies").iterdir()
    return sorted(f.name[:-5] for f in found if f.name.endswith(".onnx"))


def locate(file: str) -> FilePath:
    """The ONNX file of a policy, given as a path or as the name of one of the package.

    Raises:
        DataError: it is neither a file's name (``.onnx``) nor one of the package.
    """
    if file.endswith(".onnx"):
        return FilePath(file)
    known = shipped()
    if file not in known:
        raise DataError(
            f"{file!r} is neither an ONNX file (*.onnx) nor a policy of the package"
            f"{suggestion(file, known)}"
        )
    return FilePath(str(files("steersman.policies").joinpath(f"{file}.onnx")))


def read_policy(file: FilePath) -> tuple[bytes, PolicyCard]:
    """An ONNX file and its card, after checking that they belong together.

    Raises:
        DataError: one of them is missing, corrupt, or of another policy.
    """
    card_file = file.with_suffix(".json")
    try:
        data = file.read_bytes()
        text = card_file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        name = getattr(error, "filename", None) or card_file
        reason = getattr(error, "strerror", None) or "not text"
        raise DataError(f"{name}: cannot be read ({reason})") from None
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{card_file}: not a policy card: not valid JSON ({error})") from None
    if not isinstance(content, dict):
        raise DataError(f"{card_file}: not a policy card: expected an object of fields")
    try:
        card = PolicyCard.model_validate(content)
    except ValidationError as error:
        fault = config_error(PolicyCard, error)
        raise DataError(f"{card_file}: not a policy card: {fault}") from None
    if card.format != FORMAT:
        raise DataError(f"{card_file}: format {card.format} is not known; this version reads 1")
    if sha256(data) != card.sha256:
        raise DataError(
            f"{file}: does not match its card {card_file.name} (SHA-256 differs); "
            "the file is damaged or belongs to another policy"
        )
    return data, card
