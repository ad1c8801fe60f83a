import errno
import os
from pathlib import Path

import pytest

from exposight.errors import FileError
from exposight.files import durable_folder, is_unfinished, sweep_unfinished, write_durably


@pytest.fixture
def full_disk(monkeypatch):
    def no_space(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", no_space)


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def test_a_file_is_written(tmp_path):
    write_durably(tmp_path / "a.bin", b"new")
    assert (tmp_path / "a.bin").read_bytes() == b"new"
    assert names(tmp_path) == ["a.bin"]


def test_a_file_is_replaced(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"old and longer")
    write_durably(tmp_path / "a.bin", b"new")
    assert (tmp_path / "a.bin").read_bytes() == b"new"


def test_a_full_disk_leaves_the_old_file_and_says_so(tmp_path, full_disk):
    (tmp_path / "a.bin").write_bytes(b"old")
    with pytest.raises(FileError, match=r"a\.bin was not written: the disk is full; free some"):
        write_durably(tmp_path / "a.bin", b"new")
    assert (tmp_path / "a.bin").read_bytes() == b"old"
    assert names(tmp_path) == ["a.bin"]


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileError, match=r"the folder .*gone does not exist; make it first"):
        write_durably(tmp_path / "gone" / "a.bin", b"new")


def test_the_name_appears_only_after_the_content_is_on_the_disk(tmp_path, monkeypatch):
    seen = []
    sync = os.fsync

    def watch(descriptor):
        seen.append((tmp_path / "a.bin").exists())
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", watch)
    write_durably(tmp_path / "a.bin", b"new")
    assert seen == [False, True]  # the file first, then the folder that carries its name


def test_a_folder_appears_whole(tmp_path):
    with durable_folder(tmp_path / "f") as unfinished:
        (unfinished / "a").write_bytes(b"1")
        assert names(tmp_path) == [unfinished.name]
        assert is_unfinished(unfinished)
    assert names(tmp_path) == ["f"]
    assert (tmp_path / "f" / "a").read_bytes() == b"1"


def fill_and_fail(folder: Path) -> None:
    with durable_folder(folder) as unfinished:
        (unfinished / "a").write_bytes(b"1")
        raise RuntimeError


def test_a_folder_does_not_appear_when_filling_it_fails(tmp_path):
    with pytest.raises(RuntimeError):
        fill_and_fail(tmp_path / "f")
    assert names(tmp_path) == []


def fill(folder: Path) -> None:
    with durable_folder(folder) as unfinished:
        (unfinished / "a").write_bytes(b"1")


def test_a_folder_does_not_appear_on_a_full_disk(tmp_path, full_disk):
    with pytest.raises(FileError, match="f was not written: the disk is full"):
        fill(tmp_path / "f")
    assert names(tmp_path) == []


def test_a_folder_that_is_there_is_not_replaced(tmp_path):
    (tmp_path / "f").mkdir()
    with pytest.raises(FileError, match="f was not written: File exists"):
        fill(tmp_path / "f")
    assert names(tmp_path / "f") == []


def test_sweeping_removes_only_what_is_unfinished(tmp_path):
    (tmp_path / ".a.bin.0123abcd.unfinished").write_bytes(b"half")
    (tmp_path / ".f.0123abcd.unfinished").mkdir()
    (tmp_path / ".f.0123abcd.unfinished" / "a").write_bytes(b"half")
    (tmp_path / "a.bin").write_bytes(b"whole")
    assert sweep_unfinished(tmp_path) == 2
    assert names(tmp_path) == ["a.bin"]
