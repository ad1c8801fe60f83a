import errno
import hashlib
import os
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from exposight.errors import DamagedFileError, FileError, FormatError, MissingFileError
from exposight.files import (
    LARGEST_DOCUMENT,
    LARGEST_FILE,
    KeptFiles,
    durable_folder,
    is_unfinished,
    read_bytes,
    read_text,
    read_verified,
    sweep_unfinished,
    write_durably,
)


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


def test_a_link_stays_and_its_file_is_written(tmp_path):
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "a.bin", tmp_path / "link"
    link.symlink_to(target)
    for data in (b"new", b"newer"):  # its file is not there yet, and is
        write_durably(link, data)
        assert link.is_symlink()
        assert target.read_bytes() == data
    assert names(tmp_path / "there") == ["a.bin"]


def test_what_is_no_file_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name, kind in (("pipe", "pipe"), ("link", "pipe"), ("folder", "a folder")):
        with pytest.raises(FileError, match=f"was not written: it is .*{kind}.*, not a file"):
            write_durably(tmp_path / name, b"new")
    assert (tmp_path / "pipe").is_fifo()


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
    sweep_unfinished(tmp_path)
    assert names(tmp_path) == ["a.bin"]


HALF = """
import os, signal, sys, time
from pathlib import Path
from exposight.files import durable_folder, write_durably

def stop(path, data):
    print(path.name, flush=True)
    time.sleep(60)

Path.write_bytes = stop
if sys.argv[2] == "file":
    write_durably(Path(sys.argv[1]) / "a.bin", b"new")
else:
    with durable_folder(Path(sys.argv[1]) / "f") as unfinished:
        (unfinished / "a").touch()
        stop(unfinished, b"")
"""


@contextmanager
def writer_in_the_middle(folder: Path, kind: str):
    """Run a writer in another process; it is killed at the end."""
    command = [sys.executable, "-c", HALF, str(folder), kind]
    with subprocess.Popen(command, stdout=subprocess.PIPE, encoding="utf-8") as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
        process.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks there")
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_whoever_writes_next_removes_what_a_killed_writer_left_but_no_living_one_s(tmp_path, kind):
    with writer_in_the_middle(tmp_path, kind) as name:
        write_durably(tmp_path / "b.bin", b"new")
        assert names(tmp_path) == [name, "b.bin"]
    write_durably(tmp_path / "b.bin", b"newer")
    assert names(tmp_path) == ["b.bin"]


@pytest.mark.skipif(sys.platform == "win32", reason="no such locks there")
def test_a_sweep_lets_a_living_writer_go_on(tmp_path):
    with durable_folder(tmp_path / "new") as folder:
        (folder / "a").write_bytes(b"whole")
        sweep_unfinished(tmp_path)
    assert (tmp_path / "new" / "a").read_bytes() == b"whole"


def test_without_locks_what_is_swept_under_a_living_writer_does_not_appear_in_part(
    tmp_path, monkeypatch
):
    fcntl = pytest.importorskip("fcntl")

    def refuse(_descriptor, _kind):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    rmtree = shutil.rmtree

    def slowly(entry, **options):
        """Remove one file, let the writer finish, and then the rest."""
        (entry / "a").unlink()
        with suppress(OSError):
            unfinished.rename(tmp_path / "new")
        rmtree(entry, **options)

    def write():
        nonlocal unfinished
        with durable_folder(tmp_path / "new") as unfinished:
            for name in "ab":
                (unfinished / name).write_bytes(b"whole")
            monkeypatch.setattr(shutil, "rmtree", slowly)
            sweep_unfinished(tmp_path)
            monkeypatch.setattr(shutil, "rmtree", rmtree)

    unfinished = tmp_path
    with pytest.raises(FileError):
        write()
    assert names(tmp_path) == []


@pytest.mark.parametrize("name", [".a.bin.0123abcd.unfinished", ".00000000-0123abcd.unfinished"])
def test_what_another_machine_may_be_writing_is_left_for_a_day(tmp_path, name):
    (tmp_path / name).write_bytes(b"half")
    write_durably(tmp_path / "b.bin", b"new")
    assert names(tmp_path) == [name, "b.bin"]
    yesterday = time.time() - 86500
    os.utime(tmp_path / name, (yesterday, yesterday))
    write_durably(tmp_path / "b.bin", b"newer")
    assert names(tmp_path) == ["b.bin"]


def test_a_file_swept_before_its_writer_locked_it_is_made_again(tmp_path, monkeypatch):
    touch = Path.touch
    swept = []

    def make(path):
        touch(path)
        if not swept:
            swept.append(path)
            path.unlink()

    monkeypatch.setattr(Path, "touch", make)
    write_durably(tmp_path / "a.bin", b"new")
    assert swept
    assert names(tmp_path) == ["a.bin"]


def test_files_of_users_are_not_taken_for_unfinished_ones(tmp_path):
    for name in ("thesis.unfinished", ".unfinished", ".notes.unfinished"):
        (tmp_path / name).write_bytes(b"mine")
        assert not is_unfinished(tmp_path / name)


def test_a_disk_without_locks_is_written_and_what_is_left_there_stays_a_day(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl")

    def refuse(_descriptor, _kind):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    with writer_in_the_middle(tmp_path, "file") as name:
        pass
    monkeypatch.setattr(fcntl, "flock", refuse)
    write_durably(tmp_path / "b.bin", b"new")
    assert names(tmp_path) == [name, "b.bin"]


def test_where_windows_has_no_locks_and_syncs_no_folders_a_days_age_decides(tmp_path, monkeypatch):
    with writer_in_the_middle(tmp_path, "file") as name:
        pass
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.delattr(os, "O_DIRECTORY", raising=False)
    write_durably(tmp_path / "b.bin", b"new")
    with durable_folder(tmp_path / "c") as folder:
        (folder / "inside.bin").write_bytes(b"new")
    assert names(tmp_path) == [name, "b.bin", "c"]
    yesterday = time.time() - 86500
    os.utime(tmp_path / name, (yesterday, yesterday))
    write_durably(tmp_path / "b.bin", b"newer")
    assert names(tmp_path) == ["b.bin", "c"]


def test_names_of_255_bytes_are_written(tmp_path):
    name = "é" * 127 + "n"
    write_durably(tmp_path / name, b"new")
    with durable_folder(tmp_path / f"{name[:-1]}f"):
        pass
    assert names(tmp_path) == sorted([name, f"{name[:-1]}f"])


def test_ctrl_c_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(_path, _data):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_bytes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_durably(tmp_path / "a.bin", b"new")
    assert names(tmp_path) == []


def test_what_cannot_be_read_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no list at .*gone\.csv"):
        read_bytes(tmp_path / "gone.csv", "list")
    with pytest.raises(FileError, match="cannot be read"):
        read_bytes(tmp_path, "list")
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match=r"a\.csv is not UTF-8 text; expected a list"):
        read_text(tmp_path / "a.csv", "list")


def test_a_checksum_on_record_is_verified(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"a")
    assert read_verified(path, hashlib.sha256(b"a").hexdigest(), "file") == b"a"
    with pytest.raises(DamagedFileError, match=r"a\.txt is damaged"):
        read_verified(path, hashlib.sha256(b"b").hexdigest(), "file")


def test_a_file_is_found_while_what_decides_it_is_the_same(tmp_path):
    kept = KeptFiles(tmp_path, "plan", "scene")
    assert kept.find("a.csv") is None
    kept.keep("a.csv", b"1")
    assert kept.find("a.csv") == kept.path("a.csv")
    assert kept.path("a.csv").read_bytes() == b"1"
    assert KeptFiles(tmp_path, "another plan", "scene").find("a.csv") is None
    assert kept.find("b.csv") is None


@pytest.mark.parametrize("suffix", ["csv", "sha256"])
def test_a_damaged_file_is_made_again(tmp_path, suffix):
    kept = KeptFiles(tmp_path, "plan")
    kept.keep("a.csv", b"1")
    kept.path("a.csv").with_suffix(f".{suffix}").write_bytes(b"\xff")
    assert kept.find("a.csv") is None
    kept.keep("a.csv", b"1")
    assert kept.find("a.csv")


def test_a_file_without_a_seal_is_not_believed(tmp_path):
    kept = KeptFiles(tmp_path, "plan")
    kept.path("a.csv").write_bytes(b"1")
    assert kept.find("a.csv") is None


@pytest.mark.parametrize("other", [("plan", "b.csv"), ("another plan", "a.csv")])
def test_a_file_that_was_renamed_is_not_believed(tmp_path, other):
    kept = KeptFiles(tmp_path, "plan")
    kept.keep("a.csv", b"1")
    decisive, name = other
    path = KeptFiles(tmp_path, decisive).path(name)
    kept.path("a.csv").rename(path)
    kept.path("a.csv").with_suffix(".sha256").rename(path.with_suffix(".sha256"))
    assert KeptFiles(tmp_path, decisive).find(name) is None


def test_what_is_not_there_cannot_be_sealed(tmp_path):
    with pytest.raises(FileError):
        KeptFiles(tmp_path, "plan").seal("a.csv")


def test_devices_and_files_without_end_are_not_read(tmp_path):
    with pytest.raises(FileError, match="is a device"):
        read_bytes(Path("/dev/zero"), "sensor file")
    path = tmp_path / "sparse"
    with path.open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(FileError, match="may have up to"):
        read_bytes(path, "sensor file")


def test_a_document_that_is_too_large_is_not_read(tmp_path):
    path = tmp_path / "plan.toml"
    with path.open("wb") as file:
        file.truncate(LARGEST_DOCUMENT + 1)
    with pytest.raises(FileError, match=r"plan may have up to 64\.0 MB"):
        read_text(path, "plan")
    assert len(read_bytes(path, "table")) == LARGEST_DOCUMENT + 1


def test_pieces_are_written_like_a_whole_or_not_at_all(tmp_path):
    path = tmp_path / "table.csv"
    write_durably(path, (piece for piece in (b"a\n", b"b\n")))
    assert path.read_bytes() == b"a\nb\n"

    def broken():
        yield b"c\n"
        raise MemoryError

    with pytest.raises(MemoryError):
        write_durably(path, broken())
    assert path.read_bytes() == b"a\nb\n"
    assert list(tmp_path.iterdir()) == [path]
