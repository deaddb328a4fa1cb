"""Nothing already written is ever lost."""

import errno
import os
import socket
import subprocess
import sys
from pathlib import Path as FilePath

import pytest

from steersman.errors import DataError
from steersman.files import LOCK, alone, make_folder, only_one, replacing, write_text


def names(folder):
    return sorted(entry.name for entry in folder.iterdir())


def test_write_text_makes_folders_and_writes_utf8(tmp_path):
    file = tmp_path / "a" / "b" / "text.txt"
    write_text(file, "°\nline\n")
    assert file.read_bytes() == "°\nline\n".encode()
    assert names(file.parent) == ["text.txt"]


def test_it_replaces_only_when_complete(tmp_path):
    file = tmp_path / "text.txt"
    write_text(file, "old")
    with replacing(file) as stream:
        stream.write(b"new")
        stream.flush()
        assert file.read_text() == "old"
    assert file.read_text() == "new"
    assert file.stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_block_that_raises_leaves_everything_as_it_was(tmp_path, error):
    file = tmp_path / "text.txt"
    write_text(file, "old")

    def write():
        with replacing(file) as stream:
            stream.write(b"half of it")
            raise error

    with pytest.raises(error):
        write()
    assert file.read_text() == "old"
    assert names(tmp_path) == ["text.txt"]


def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path):
    file = tmp_path / "text.txt"
    write_text(file, "old")

    def write():
        with replacing(file):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(DataError, match=r"text\.txt: cannot be written \(No space left"):
        write()
    assert file.read_text() == "old"
    assert names(tmp_path) == ["text.txt"]


def test_a_folder_in_the_place_of_the_file(tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(DataError, match="taken: cannot be written"):
        write_text(tmp_path / "taken", "text")
    assert names(tmp_path) == ["taken"]


def test_what_is_no_regular_file_is_never_replaced(tmp_path):
    fifo, link = tmp_path / "fifo", tmp_path / "link"
    os.mkfifo(fifo)
    link.symlink_to(fifo)
    door = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(door))
        for name, kind in ((fifo, "a FIFO"), (link, "a FIFO"), (door, "a socket")):
            with pytest.raises(DataError, match=rf"{name.name}: cannot be written \(it is {kind}"):
                write_text(name, "text")
    with pytest.raises(DataError, match=r"/dev/null: cannot be written \(it is a character device"):
        write_text(FilePath(os.devnull), "text")
    assert fifo.is_fifo()
    assert door.is_socket()
    assert link.is_symlink()
    assert names(tmp_path) == ["fifo", "link", "socket"]


def test_a_file_in_the_place_of_a_folder(tmp_path):
    write_text(tmp_path / "taken", "text")
    with pytest.raises(DataError, match="taken: cannot be made"):
        write_text(tmp_path / "taken" / "below.txt", "text")
    with pytest.raises(DataError, match="taken: cannot be made"):
        make_folder(tmp_path / "taken")


def test_a_name_that_is_too_long(tmp_path):
    with pytest.raises(DataError, match="cannot be written"):
        write_text(tmp_path / ("x" * 300), "text")


def test_a_link_stays_a_link(tmp_path):
    target = tmp_path / "target.txt"
    write_text(target, "old")
    link = tmp_path / "link.txt"
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_make_folder_returns_it_and_may_be_repeated(tmp_path):
    assert make_folder(make_folder(tmp_path / "a" / "b")).is_dir()


HOLD = (
    "import sys, time; from pathlib import Path; from steersman.files import only_one\n"
    "with only_one(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("steersman.files.PATIENCE", 0.1)


@pytest.mark.usefixtures("impatient")
def test_a_folder_is_one_process_alone_until_that_is_killed(tmp_path: FilePath) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "runs")], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with (
            pytest.raises(DataError, match="another process works in it"),
            only_one(tmp_path / "runs"),
        ):
            pass
        with only_one(tmp_path / "elsewhere"):
            other.kill()
    assert names(tmp_path / "runs") == [LOCK]  # nobody tidied up
    with only_one(tmp_path / "runs"):
        pass
    assert names(tmp_path / "runs") == []


def test_who_takes_turns_never_works_at_the_same_time(tmp_path: FilePath) -> None:
    """Every process adds ten to a number, in two steps that another one would disturb."""
    add = (
        "import sys; from pathlib import Path; from steersman.files import only_one\n"
        "folder = Path(sys.argv[1]); number = folder / 'number'\n"
        "for _ in range(10):\n"
        "    with only_one(folder):\n"
        "        number.write_text(str(int(number.read_text()) + 1))\n"
    )
    (tmp_path / "number").write_text("0")
    command = [sys.executable, "-c", add, str(tmp_path)]
    others = [subprocess.Popen(command) for _ in range(4)]
    assert [other.wait() for other in others] == [0] * 4
    assert (tmp_path / "number").read_text() == "40"


@pytest.mark.usefixtures("impatient")
def test_a_function_that_works_alone(tmp_path: FilePath) -> None:
    @alone("out")
    def nested(out: FilePath, depth: int = 0) -> int:
        return nested(out, depth=depth - 1) if depth else 7

    assert nested(out=tmp_path) == nested(tmp_path) == 7
    with pytest.raises(DataError, match="another process"):
        nested(tmp_path, depth=1)
    assert nested(tmp_path) == 7  # released although it failed
