"""Nothing already written is ever lost."""

import errno
import os

import pytest

from steersman.errors import DataError
from steersman.files import make_folder, replacing, write_text


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
