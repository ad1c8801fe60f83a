"""One writer at a time: a lock file that the system frees when its holder ends, however it ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

from filelock import FileLock, Timeout

from exposight.errors import FileError

if TYPE_CHECKING:
    from pathlib import Path

    from filelock import BaseFileLock


WRITER_LOCK = "writer.lock"


def hold_writer_lock(folder: Path, what: str) -> BaseFileLock:
    """Take a folder's lock, which only one writer can hold.

    Parameters
    ----------
    folder : Path
        Where ``writer.lock`` lies, or is made.
    what : str
        What is written there, for messages.

    Returns
    -------
    BaseFileLock
        Call its ``release()`` to let the next writer in.

    Raises
    ------
    FileError
        If another writer holds it, or the disk refuses.
    """
    path = folder / WRITER_LOCK
    lock = FileLock(path, timeout=0, thread_local=False)  # whichever thread releases it
    try:
        lock.acquire()
    except Timeout as error:
        msg = f"another writer has {what} in {folder} open; wait until it is done, or close it"
        raise FileError(msg) from error
    except OSError as error:
        reason = error.strerror or str(error)
        if error.filename is not None:
            msg = f"{path} cannot be opened to write {what}: {reason}"
        else:
            msg = (
                f"{path} cannot be locked ({reason}), so a second writer could not be kept out; "
                f"write {what} to a local disk and copy it afterwards"
            )
        raise FileError(msg) from error
    return lock
