"""Files and folders that are either whole or absent, whatever happens while they are written.

A crash, a kill or a full disk in the middle of writing must not leave half a file under its final
name. So everything is written under a temporary name, pushed to the disk (``fsync``), and
only then renamed; POSIX makes the rename atomic. The folder is pushed to the disk too, because the
name lives there.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from exposight.errors import FileError

if TYPE_CHECKING:
    from collections.abc import Iterator


_SUFFIX = ".unfinished"


def write_durably(path: Path, data: bytes) -> None:
    """Write a file so that it is either the old one or the whole new one, never half of it.

    Parameters
    ----------
    path : Path
        The file; its folder must exist. An existing file is replaced.
    data : bytes
        The whole content of the file.

    Raises
    ------
    FileError
        If the disk is full or refuses for another reason; an existing file is then untouched.
    """
    path = Path(path)
    unfinished = _unfinished_name(path)
    try:
        _write_and_sync(unfinished, data)
        unfinished.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise _refused(path, error) from error


@contextmanager
def durable_folder(path: Path) -> Iterator[Path]:
    """Fill a new folder so that it appears whole or not at all.

    Parameters
    ----------
    path : Path
        The folder to make; it must not exist yet, its parent must.

    Yields
    ------
    Path
        A temporary folder to write files into. It is renamed to `path` when the block ends, and
        removed if the block raises.

    Raises
    ------
    FileError
        If the disk is full or refuses for another reason, or `path` exists already.
    """
    path = Path(path)
    unfinished = _unfinished_name(path)
    try:
        unfinished.mkdir()
        yield unfinished
        for file in sorted(unfinished.iterdir()):
            _sync_file(file)
        _sync_folder(unfinished)
        if path.exists():  # rename would silently replace an empty folder
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
        unfinished.rename(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def is_unfinished(path: Path) -> bool:
    """Tell whether a name is the temporary one of a file or folder being written."""
    return Path(path).name.endswith(_SUFFIX)


def sweep_unfinished(folder: Path) -> int:
    """Remove what a killed writer left under temporary names directly in a folder.

    Parameters
    ----------
    folder : Path
        Nobody else may be writing in it.

    Returns
    -------
    int
        How many were removed.
    """
    left = [entry for entry in Path(folder).iterdir() if is_unfinished(entry)]
    for entry in left:
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            entry.unlink(missing_ok=True)
    return len(left)


def _unfinished_name(path: Path) -> Path:
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}{_SUFFIX}")


def _write_and_sync(path: Path, data: bytes) -> None:
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync_file(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _sync_folder(path: Path) -> None:
    if not hasattr(os, "O_DIRECTORY"):  # Windows cannot open a folder, and keeps names itself
        return
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _refused(path: Path, error: OSError) -> FileError:
    if error.errno in {errno.ENOSPC, errno.EDQUOT}:
        reason = "the disk is full; free some space and write again"
    elif error.errno in {errno.EACCES, errno.EPERM, errno.EROFS}:
        reason = "writing there is not allowed; check the folder's permissions"
    elif error.errno == errno.ENOENT:
        reason = f"the folder {path.parent} does not exist; make it first"
    else:
        reason = error.strerror or str(error)
    return FileError(f"{path} was not written: {reason}")


def make_folder(folder: Path, what: str = "output") -> Path:
    """Make a folder with its parents if it is not there, and return it.

    Parameters
    ----------
    folder : Path
        The folder.
    what : str
        What it is for, for messages.

    Raises
    ------
    FileError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        if folder.is_file():
            reason = "it is a file, and a folder is needed"
        msg = f"{folder} cannot be used for {what}: {reason}"
        raise FileError(msg) from error
    return folder
