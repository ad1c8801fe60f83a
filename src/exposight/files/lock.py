"""One writer at a time: a lock file that the system frees when its holder ends, however it ends."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

from exposight.errors import FileError

if TYPE_CHECKING:
    from pathlib import Path


if sys.platform != "win32":
    import fcntl


WRITER_LOCK = "writer.lock"


def hold_writer_lock(folder: Path, what: str) -> int:
    """Open a folder's lock file, which only one process can hold.

    Parameters
    ----------
    folder : Path
        Where ``writer.lock`` lies, or is made.
    what : str
        What is written there, for messages.

    Returns
    -------
    int
        An open file; close it (``os.close``) to let the next writer in.

    Raises
    ------
    FileError
        If another process holds it, or the disk refuses.
    """
    path = folder / WRITER_LOCK
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        msg = f"{path} cannot be opened to write {what}: {error.strerror or error}"
        raise FileError(msg) from error
    if sys.platform == "win32":  # no such lock there: one writer at a time is up to the user
        return lock
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(lock)
        if isinstance(error, BlockingIOError):
            msg = f"another writer has {what} in {folder} open; wait until it is done, or close it"
        else:
            msg = (
                f"{path} cannot be locked ({error.strerror or error}), so a second writer could "
                f"not be kept out; write {what} to a local disk and copy it afterwards"
            )
        raise FileError(msg) from error
    return lock
