"""Writing files so that nothing already written is ever lost, and opening those of users."""

from __future__ import annotations

import inspect
import os
import stat
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path as FilePath
from typing import Any, BinaryIO, ParamSpec, TypeVar

from steersman.bounds import MOST_JSON, from_json
from steersman.errors import DataError, near_file

LOCK = ".lock"
HTML = (".html", ".htm")
# How long another process may take to end, e.g. one whose parent was killed [s].
PATIENCE = 2.0
# How a file begins that stands for one which was not fetched.
_POINTER = b"version https://git-lfs.github.com/spec/"
# What has the name of a file and is none.
_KINDS: dict[str, Callable[[int], bool]] = {
    "a folder": stat.S_ISDIR,
    "a character device": stat.S_ISCHR,
    "a block device": stat.S_ISBLK,
    "a FIFO": stat.S_ISFIFO,
    "a socket": stat.S_ISSOCK,
}
P = ParamSpec("P")
R = TypeVar("R")


@contextmanager
def reading(file: FilePath, cure: str) -> Iterator[BinaryIO]:
    """A binary stream of a user's file; ~ is the user's home, ``cure`` what to give instead.

    Raises:
        DataError: it cannot be read, or Git LFS has left a pointer in its place.
    """
    try:
        with FilePath(os.path.expanduser(file)).open("rb") as stream:
            if stream.peek(len(_POINTER)).startswith(_POINTER):
                raise DataError(f"{file}: is a pointer of Git LFS; 'git lfs pull' fetches the file")
            yield stream
    except DataError:
        raise
    except OSError as error:
        fault = "is a folder" if isinstance(error, IsADirectoryError) else None
        fault = fault or f"cannot be read ({error.strerror})"
        like = near_file(str(file), [FilePath(file).suffix])
        raise DataError(f"{file}: {fault}; {like or cure}") from None
    except ValueError:
        raise DataError(f"{str(file)!r}: is not the name of a file; {cure}") from None


def read_bytes(file: FilePath, cure: str, most: int) -> bytes:
    """The content of a user's file.

    Raises:
        DataError: it cannot be read, or is larger than ``most`` bytes.
    """
    with reading(file, cure) as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise DataError(f"{file}: is larger than {most // 1_000_000} MB, the most that is read")
    return data


def read_json(file: FilePath, cure: str = "give a JSON file") -> Any:
    """The plain data in a user's JSON file.

    Raises:
        DataError: it cannot be read, is too large, or not valid JSON.
    """
    try:
        return from_json(read_bytes(file, cure, MOST_JSON))
    except DataError:
        raise
    except ValueError as error:
        raise DataError(f"{file}: not valid JSON ({error})") from None


@contextmanager
def replacing(file: FilePath) -> Iterator[BinaryIO]:
    """A binary stream to a temporary file beside ``file`` that takes its place at the end.

    If the block raises, the temporary file goes and whatever ``file`` held stays.

    A link stays a link: what it points to is replaced.

    Raises:
        DataError: the folder cannot be written, the disk is full, or ``file`` is no regular file.
    """
    refuse_special(file)
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


def refuse_special(file: FilePath) -> None:
    """Refuse a device, a FIFO, a socket or a folder, directly or behind a link.

    A file is written by renaming another onto its name, which would put a regular file in the
    place of the device.

    Raises:
        DataError: ``file`` exists and is no regular file.
    """
    try:
        mode = os.stat(file).st_mode
    except (OSError, ValueError):
        return  # it does not exist, or opening it will give the reason
    if not stat.S_ISREG(mode):
        kind = next((words for words, is_it in _KINDS.items() if is_it(mode)), "no regular file")
        raise DataError(f"{file}: cannot be written (it is {kind})")


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


def out_folder(name: str) -> FilePath:
    """The folder for results, made if need be and proved to be writable before anything runs.

    Raises:
        DataError: it cannot be made or written.
    """
    if not name.strip():
        raise DataError("--out: expected the name of a folder, given nothing")
    folder = FilePath(name)
    if folder.exists() and not folder.is_dir():
        raise DataError(f"{folder}: is a file, expected a folder")
    make_folder(folder)
    try:
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise DataError(f"{folder}: cannot be written ({error.strerror})") from None


def out_file(name: str, option: str = "--out", endings: Sequence[str] = ()) -> FilePath:
    """The file for a result, in a folder that is proved to be writable before anything runs.

    Args:
        name: the file.
        option: what the user gave the name with.
        endings: those that its name may have; none: any.

    Raises:
        DataError: its name has another ending, it is a folder, a device or the like, or its folder
            cannot be written.
    """
    file = FilePath(name)
    if not name.strip() or file.is_dir():
        raise DataError(f"{option}: expected the name of a file, given {name!r}")
    if endings and file.suffix not in endings:
        allowed = " or ".join(endings)
        raise DataError(f"{option}: {name!r} is not allowed; a name that ends in {allowed} is")
    refuse_special(file)
    out_folder(str(file.parent))
    return file


@contextmanager
def only_one(folder: FilePath) -> Iterator[None]:
    """Keep other processes, which ask too, from working in ``folder`` at the same time.

    The lock is the operating system's: it goes with the process, however that ends. The file of
    the lock means nothing by itself; one that a killed process left is taken over.

    Raises:
        DataError: another process works there, or the folder cannot be written.
    """
    from filelock import FileLock, Timeout

    new = not folder.exists()
    file = make_folder(folder) / LOCK
    lock = FileLock(file)
    try:
        lock.acquire(timeout=PATIENCE)
    except Timeout:
        raise DataError(
            f"{folder}: another process works in it; wait for its end, or give another folder"
        ) from None
    except OSError as error:
        raise DataError(f"{file}: cannot be written ({error.strerror or error})") from None
    try:
        yield
    finally:
        # Who waits for a file that is gone by then looks for the new one, says filelock's source.
        with suppress(OSError):  # Windows removes it itself, and only then
            file.unlink()
        lock.release()
        if new:  # what came to nothing leaves nothing
            with suppress(OSError):
                folder.rmdir()


def alone(argument: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Makes a function hold :func:`only_one` of the folder that ``argument`` names."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        signature = inspect.signature(function)

        @wraps(function)
        def locked(*args: P.args, **kwargs: P.kwargs) -> R:
            with only_one(FilePath(signature.bind(*args, **kwargs).arguments[argument])):
                return function(*args, **kwargs)

        return locked

    return decorate
