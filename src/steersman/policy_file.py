"""The card that travels with an exported policy: what it must be fed and what it answers."""

from __future__ import annotations

import hashlib
from importlib.resources import files
from pathlib import Path as FilePath
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from steersman.bounds import MOST_JSON, from_json
from steersman.errors import DataError, suggestion
from steersman.files import read_bytes
from steersman.messages import config_error

FORMAT = 2
LEARNED = ("policy", "adaptive")
"""Kinds of controllers that read a policy's file."""
UNITS = {
    "time": "s",
    "length": "m",
    "angle": "rad",
    "steer": "1 = full lock, left positive",
    "action": "[-1, 1]: steering, steering rate over rate_limit, correction over authority, or "
    "places of the parameters between their bounds; joint: then the speed, 0 and above as wished, "
    "-1 standstill",
}
SIGNS = {
    "frame": "ISO 8855: x forward, y left, z up; waypoints are in the vehicle's frame",
    "steer": "positive to the left",
    "lateral_error": "positive where the vehicle is left of the path",
    "heading_error": "yaw less the path's tangent, positive anticlockwise",
    "v_y": "positive to the left",
    "yaw_rate": "positive anticlockwise",
    "curvature": "positive where the path bends to the left",
}
# A file beside the card: its name and no way to another folder.
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_+-][A-Za-z0-9_.+ -]*$")]
Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class PolicyCard(BaseModel):
    """Everything needed to run ``policy.onnx``; written beside it as ``policy.json``.

    ``dt`` is the control period [s]; ``observation`` names each input of the network in its order.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    format: int = FORMAT
    files: dict[FileName, Digest]
    """SHA-256 of each file that the card was delivered with."""
    action: str
    joint: bool = False
    """Whether a second action is the speed, see ``units``."""
    rate_limit: float | None = Field(gt=0)
    """Largest rate of normalised steering [1/s] if the action is ``rate``, else null."""
    base: dict[str, Any] | None = None
    """Controller that steers under a ``residual`` action or under ``parameters``, else null."""
    authority: float | None = Field(default=None, gt=0)
    """Largest correction of normalised steering, else null."""
    base_share: float = Field(default=1.0, ge=0, le=1)
    """Share of the base's steering that is corrected."""
    parameters: dict[str, str | list[Any]] | None = None
    """Fields of the base that the actions set, and their bounds or choices, else null."""
    period: int = Field(default=1, ge=1)
    """Control steps for which an action of ``parameters`` holds."""
    dt: float = Field(gt=0)
    waypoints: int = Field(ge=0)
    spacing: float = Field(gt=0)
    trim: float = Field(default=0.0, ge=0)
    """Rate of the integral loop around the network [1/s]."""
    encoding: dict[str, Any]
    observation: list[str]
    scale: list[float]
    units: dict[str, str]
    signs: dict[str, str]
    limits: dict[str, list[float]]
    seed: int
    training: dict[str, Any]
    versions: dict[str, str]
    commit: str | None
    made_for: dict[str, Any] | None = None
    """What C was made of and for: controller, vehicle, precision, constants; else null."""

    @property
    def actions(self) -> int:
        """Outputs of the network."""
        return len(self.parameters or "1") + self.joint

    @model_validator(mode="after")
    def _whole(self) -> PolicyCard:
        if self.joint and self.parameters:
            raise ValueError("joint: parameters of a base do not go with a speed")
        if self.base is None and (self.authority or self.parameters):
            raise ValueError("authority and parameters are those of a base")
        if self.base is not None and (self.authority is None) == (not self.parameters):
            raise ValueError("base and either authority or parameters go together")
        if self.base is not None and self.rate_limit is not None:
            raise ValueError("rate_limit: an action on a base has none")
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
    """An ONNX file and its card, after checking every file that the card was delivered with.

    Raises:
        DataError: one of them is missing, corrupt, or of another policy.
    """
    card_file = file.with_suffix(".json")
    data, text = _read(file), _read(card_file)
    try:
        content = from_json(text)
    except UnicodeDecodeError:
        raise DataError(f"{card_file}: cannot be read (not text)") from None
    except ValueError as error:
        raise DataError(f"{card_file}: not a policy card: not valid JSON ({error})") from None
    if not isinstance(content, dict):
        raise DataError(f"{card_file}: not a policy card: expected an object of fields")
    try:
        card = PolicyCard.model_validate(_of_today(content, file.name))
    except ValidationError as error:
        fault = config_error(PolicyCard, error)
        raise DataError(f"{card_file}: not a policy card: {fault}") from None
    if card.format != FORMAT:
        raise DataError(f"{card_file}: format {card.format} is not known; this version reads 1, 2")
    _verify(file, data, card)
    return data, card


def _read(file: FilePath) -> bytes:
    return read_bytes(file, "give a policy (*.onnx) with its card (*.json) beside it", MOST_JSON)


def _of_today(content: dict[str, Any], network: str) -> dict[str, Any]:
    """A card of format 1 in today's words: it held the digest of the network alone."""
    if content.get("format") != 1 or "sha256" not in content:
        return content
    new = {"format": FORMAT, "files": {network: content["sha256"]}, "signs": SIGNS}
    return {name: value for name, value in content.items() if name != "sha256"} | new


def _verify(file: FilePath, network: bytes, card: PolicyCard) -> None:
    """Compare the digest of every file that the card names; the network may have a new name."""
    expected = dict(card.files)
    old = [name for name in expected if name.endswith(".onnx")]
    if file.name not in expected and len(old) == 1:
        expected[file.name] = expected.pop(old[0])
    if file.name not in expected:
        raise DataError(f"{file}: not among the files of its card {file.stem}.json")
    for name, digest in expected.items():
        data = network if name == file.name else _read(file.with_name(name))
        given = sha256(data)
        if given != digest:
            raise DataError(
                f"{file.with_name(name)}: its SHA-256 is {given}, but its card {file.stem}.json "
                f"says {digest}; the file was changed or belongs to another policy"
            )
