"""State as plain data: trees of numbers, texts, arrays, that a file can hold without pickle.

What takes part in a checkpoint has ``snapshot``, which returns such a tree, and ``restore``,
which takes it back. A snapshot shares its arrays with what it was taken of: write it at once.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from steersman.bounds import from_json, read_arrays
from steersman.errors import ControllerError, DataError

Tree: TypeAlias = Mapping[str, Any]
_STATE = "state"
_ARRAY = "$array"
_SAME = "="


def write(tree: Tree, stream: BinaryIO) -> None:
    """Write a tree as an npz file: its arrays by their dotted names, the rest as JSON."""
    arrays: dict[str, Any] = {}
    text = json.dumps(_pack(tree, "", arrays)).encode("utf-8")
    arrays[_STATE] = np.frombuffer(text, np.uint8)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def read(stream: BinaryIO) -> dict[str, Any]:
    """The tree in a file of :func:`write`.

    Raises:
        DataError: it is truncated or damaged; every byte is checked before any is used.
    """
    try:
        arrays = read_arrays(stream)
        tree = _unpack(from_json(arrays.pop(_STATE).tobytes()), arrays)
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise DataError(str(error) or type(error).__name__) from None
    if not isinstance(tree, dict):
        raise DataError("holds no state")
    return tree


def _pack(value: Any, name: str, arrays: dict[str, Any]) -> Any:
    if isinstance(value, Mapping):
        return {key: _pack(v, f"{name}.{key}".lstrip("."), arrays) for key, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        arrays[name] = np.asarray(value)
        return {_ARRAY: name}
    if isinstance(value, list | tuple):
        return [_pack(v, f"{name}.{i}", arrays) for i, v in enumerate(value)]
    return value


def _unpack(value: Any, arrays: Mapping[str, Any]) -> Any:
    if isinstance(value, dict):
        if _ARRAY in value:
            array = arrays[value[_ARRAY]]
            return array if array.ndim else array[()]
        return {key: _unpack(v, arrays) for key, v in value.items()}
    return [_unpack(v, arrays) for v in value] if isinstance(value, list) else value


def fill(targets: Mapping[str, Any], saved: Tree) -> None:
    """Overwrite arrays with those saved under the same names.

    Raises:
        DataError: one is missing, or of another shape or type.
    """
    for name, target in targets.items():
        source = np.asarray(saved.get(name))
        if (source.shape, source.dtype) != (target.shape, target.dtype):
            raise DataError(
                f"{name}: holds {source.dtype} {source.shape}, "
                f"expected {target.dtype} {target.shape}"
            )
        target[...] = source


def changed(state: Any, fresh: Any) -> Any:
    """What distinguishes a controller's state from the one that ``init`` returned.

    States are named tuples, nested at will. A part that still is the very object that ``init``
    made (a model, a vehicle, a network) is not stored; numbers, texts and arrays are.

    >>> from steersman.controllers.pid import PidState
    >>> fresh = PidState()
    >>> rebuilt(changed(fresh._replace(error=0.5), fresh), fresh)
    PidState(integral=0.0, derivative=0.0, error=0.5)

    Raises:
        ControllerError: the state holds something else that is new.
    """
    if state is fresh:
        return _SAME
    if isinstance(state, tuple) and (not hasattr(state, "_fields") or type(state) is type(fresh)):
        return [changed(part, was) for part, was in _beside(state, fresh)]
    if state is None or isinstance(state, bool | int | float | str | np.ndarray | np.generic):
        return {"is": state}
    raise ControllerError(
        f"a controller's state holds a new {type(state).__name__}, which no checkpoint can keep; "
        "what changes must be numbers, texts, arrays, or named tuples of them"
    )


def rebuilt(saved: Any, fresh: Any) -> Any:
    """The state of which :func:`changed` was made."""
    if isinstance(saved, str):
        return fresh
    if isinstance(saved, list):
        parts = [rebuilt(part, was) for part, was in _beside(saved, fresh)]
        return type(fresh)(*parts) if hasattr(fresh, "_fields") else tuple(parts)
    return saved["is"]


def _beside(parts: Sequence[Any], fresh: Any) -> list[tuple[Any, Any]]:
    """Each part with its counterpart in the fresh state, None where there is none."""
    before = fresh[: len(parts)] if isinstance(fresh, tuple) else ()
    return list(zip_longest(parts, before))
