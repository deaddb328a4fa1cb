"""Writing files so that nothing already written is ever lost."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import BinaryIO

from steersman.errors import DataError


@contextmanager
def replacing(file: FilePath) -> Iterator[BinaryIO]:
    """A binary stream to a temporary file beside ``file`` that takes its place at the end.

    If the block raises, the temporary file goes and whatever ``file`` held stays.

    A link stays a link: what it points to is replaced.

    Raises:
        DataError: the folder cannot be written, the disk is full, or ``file`` is a folder.
    """
    file = FilePath(os.path.realpath(file))
    make_folder(file.parent)
    try:
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
    except OSError as error:
        raise DataError(f"{file}: cannot be written ({error.strerror})") from None
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(name, 0o644)
        os.replace(name, file)
    except OSError as error:
        FilePath(name).unlink(missing_ok=True)
        raise DataError(f"{file}: cannot be written ({error.strerror or error})") from error
    except BaseException:
        FilePath(name).unlink(missing_ok=True)
        raise


def write_text(file: FilePath, text: str) -> None:
    """Write ``text`` as UTF-8, replacing ``file`` only when complete."""
    with replacing(file) as stream:
        stream.write(text.encode("utf-8"))


def make_folder(folder: FilePath) -> FilePath:
    """Make ``folder`` and its parents if need be.

    Raises:
        DataError: it cannot be made, or something else has its name.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"{folder}: cannot be made ({error.strerror})") from None
    return folder
