"""Files and folders that are whole or absent, locked while written, and verified when read.

A crash, a kill or a full disk in the middle of writing must not leave half a file under its final
name. So everything is written under a temporary name, pushed to the disk (``fsync``), and
only then renamed; POSIX makes the rename atomic. The folder is pushed to the disk too, because the
name lives there.

Who is killed leaves what has a temporary name; whoever writes next beside it removes it. That its
writer is dead is known from a lock, which ends with the process that holds it.
"""

import errno
import hashlib
import logging
import os
import platform
import re
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

from exposight.errors import (
    DamagedFileError,
    FileError,
    FormatError,
    LockedError,
    MissingFileError,
)

WRITER_LOCK = "writer.lock"
_HERE = hashlib.sha256(platform.node().encode()).hexdigest()[:8]
"""This machine in a temporary name: what locks say of another's writers depends on the disk."""
_UNFINISHED = re.compile(r"\.(?:[0-9a-f]{8}-|.+\.)[0-9a-f]{8}\.unfinished")
"""Temporary names: machine and chance; of earlier versions final name and chance."""
LARGEST_FILE = 8 * 2**30
"""Bytes; a file is read as a whole."""
LARGEST_DOCUMENT = 64_000_000
"""Bytes of a plan, a scene, settings: parsed they take some 50 times that. None comes near."""
_DAY_S = 86400.0
"""Where a lock does not tell, what has not changed for so long has no writer any more."""
_logger = logging.getLogger(__name__)


def write_durably(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write a file so that it is either the old one or the whole new one, never half of it.

    Parameters
    ----------
    path : Path
        The file; its folder must exist. An existing file is replaced; of a symbolic link the file
        that it points to.
    data : bytes or iterable of bytes
        The whole content of the file, or its pieces.

    Raises
    ------
    FileError
        If the disk is full or refuses for another reason; an existing file is then untouched. If
        there is something else than a file, such as a device or a pipe.
    """
    path = Path(os.path.realpath(path)) if Path(path).is_symlink() else Path(path)
    _check_replaceable(path)
    try:
        _sweep_dead(path.parent)
        with _unfinished(path.parent, Path.touch) as unfinished:
            if isinstance(data, bytes):
                unfinished.write_bytes(data)
            else:
                with unfinished.open("wb") as file:
                    file.writelines(data)
            _sync(unfinished)
            unfinished.replace(path)
            _sync_folder(path.parent)
    except OSError as error:
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
        removed if the block raises. It may have folders in it.

    Raises
    ------
    FileError
        If the disk is full or refuses for another reason, or `path` exists already.
    """
    path = Path(path)
    try:
        _sweep_dead(path.parent)
        with _unfinished(path.parent, Path.mkdir) as unfinished:
            yield unfinished
            for entry in (*sorted(unfinished.rglob("*")), unfinished):
                (_sync_folder if entry.is_dir() else _sync)(entry)
            if path.exists():  # rename would silently replace an empty folder
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
            unfinished.rename(path)
            _sync_folder(path.parent)
    except OSError as error:
        raise _refused(path, error) from error


def is_unfinished(path: Path) -> bool:
    """Tell whether a name is the temporary one of a file or folder being written."""
    return _UNFINISHED.fullmatch(Path(path).name) is not None


def sweep_unfinished(folder: Path) -> None:
    """Remove what a killed writer left under temporary names directly in a folder.

    Parameters
    ----------
    folder : Path
        Nobody else should be writing in it. Whoever is, as a worker that was given up, goes on
        where the disk has locks; else what it writes is refused, and does not appear in part.
    """
    for entry in list(filter(is_unfinished, Path(folder).iterdir())):
        with suppress(OSError), _locked(entry):
            _remove(entry)


def _sweep_dead(folder: Path) -> None:
    """Remove what killed writers left in a folder, where others may be writing."""
    names: list[str] = []
    with suppress(OSError):  # writing in it will tell
        names += filter(_UNFINISHED.fullmatch, os.listdir(folder))  # noqa: PTH208
    for entry in map(folder.joinpath, names):
        with suppress(OSError), _locked(entry) as locked:  # held by its writer, or another's
            certain = locked and entry.name.startswith(f".{_HERE}-")
            if certain or time.time() - entry.lstat().st_mtime > _DAY_S:
                _remove(entry)


def _remove(entry: Path) -> None:
    if entry.is_dir():
        # First away from its writer, which could give the final name to what is half removed.
        aside = entry.with_name(f".{_HERE}-{secrets.token_hex(4)}.unfinished")
        with suppress(OSError):
            shutil.rmtree(entry.rename(aside), ignore_errors=True)
    else:
        entry.unlink(missing_ok=True)


@contextmanager
def _unfinished(folder: Path, make: Callable[[Path], None]) -> Iterator[Path]:
    """Make a temporary file or folder; it is locked within the block, and removed at its end.

    Its name is short whatever the final one is, so that names of 255 bytes can be written.
    """
    with ExitStack() as stack:
        while True:
            path = folder / f".{_HERE}-{secrets.token_hex(4)}.unfinished"
            stack.callback(_remove, path)
            make(path)
            with suppress(BlockingIOError, FileNotFoundError):  # swept before it was locked
                stack.enter_context(_locked(path))
                break
        yield path


@contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Hold the lock of a temporary file or folder; whether this system and disk have locks.

    Raises
    ------
    OSError
        If another process holds it, or it is neither a file nor a folder of this user.
    """
    if sys.platform == "win32":  # which moves no open file; there a day's age decides
        yield False
        return
    import fcntl

    kind = path.lstat().st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    access = os.O_RDONLY if stat.S_ISDIR(kind) else os.O_RDWR  # a network disk asks for it
    descriptor = os.open(path, access | os.O_NOFOLLOW)
    try:
        locked = True
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:  # no locks on this disk
            locked = False
        if not os.path.samestat(os.fstat(descriptor), path.lstat()):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        yield locked
    finally:
        os.close(descriptor)


def _check_replaceable(path: Path) -> None:
    """Refuse a folder, a device or a pipe, which a file would take the place of."""
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "a device, a pipe or the like"
        msg = f"{path} was not written: it is {kind}, not a file; give the name of a file"
        raise FileError(msg)


def _sync(path: Path) -> None:
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


def sha256_of(data: bytes) -> str:
    """Return the SHA-256 checksum of bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def read_bytes(path: Path, what: str, *, largest: int | None = None) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it is, for messages.
    largest : int, bytes, optional
        No larger file is read; `LARGEST_FILE` by default.

    Raises
    ------
    MissingFileError
        If it is not there.
    FileError
        If the disk refuses, it is a device, which has no end, or larger than `LARGEST_FILE`.
    """
    largest = LARGEST_FILE if largest is None else largest
    try:
        with Path(path).open("rb") as file:
            kind, size = os.fstat(file.fileno())[stat.ST_MODE], os.fstat(file.fileno()).st_size
            if stat.S_ISCHR(kind) or stat.S_ISBLK(kind):
                msg = f"{path} is a device, no {what}"
                raise FileError(msg)
            if size > largest:
                msg = (
                    f"{path} has {size / 1e6:.1f} MB; a {what} may have up to "
                    f"{largest / 1e6:.1f} MB: give a part of it"
                )
                raise FileError(msg)
            return file.read()
    except FileNotFoundError as error:
        msg = f"no {what} at {path}"
        raise MissingFileError(msg) from error
    except OSError as error:
        msg = f"{path} cannot be read: {error.strerror or error}; check the disk and permissions"
        raise FileError(msg) from error


def read_text(path: Path, what: str) -> str:
    """Return the content of a document in UTF-8; see `read_bytes`.

    Raises
    ------
    FormatError
        If it is not UTF-8 text.
    MissingFileError, FileError
        As `read_bytes`; no document is larger than `LARGEST_DOCUMENT`.
    """
    try:
        return read_bytes(path, what, largest=LARGEST_DOCUMENT).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        msg = f"{path} is not UTF-8 text; expected a {what}"
        raise FormatError(msg) from error


def read_verified(path: Path, sha256: str, what: str) -> bytes:
    """Return the content of a file whose SHA-256 is on record; see `read_bytes`.

    Raises
    ------
    DamagedFileError
        If its checksum is another.
    MissingFileError, FileError
        As `read_bytes`.
    """
    data = read_bytes(path, what)
    if sha256_of(data) != sha256:
        msg = (
            f"{path} is damaged: its SHA-256 is not the one on record; restore it from a copy, or "
            "delete it with the folder it is in and make it again"
        )
        raise DamagedFileError(msg)
    return data


def hold_writer_lock(
    folder: Path, what: str, name: str = WRITER_LOCK, *, timeout_s: float = 0.0
) -> BaseFileLock:
    """Take a lock that only one writer can hold: of a folder, or of a file in it.

    Parameters
    ----------
    folder : Path
        Where the lock's file lies, or is made.
    what : str
        What is written there, for messages.
    name : str
        Name of the lock's file.
    timeout_s : float, s
        How long to wait for a writer that holds it.

    Returns
    -------
    BaseFileLock
        Call its ``release()`` to let the next writer in.

    Raises
    ------
    LockedError
        If another writer holds it.
    FileError
        If the disk refuses.
    """
    path = folder / name
    lock = FileLock(path, timeout=timeout_s, thread_local=False)  # whichever thread releases it
    try:
        lock.acquire()
    except Timeout as error:
        msg = f"another writer has {what} in {folder} open; wait until it is done, or close it"
        raise LockedError(msg) from error
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


class KeptFiles:
    """Files in a folder that need not be made again while all that decides them is the same.

    A file's name carries a checksum of what decides its content, so that a file which other inputs
    made is never taken for this one. Beside each lies its seal, a SHA-256 of its bytes, its
    name and all that decides it; a file that was damaged, renamed, or has no seal, is removed when
    it is looked up, and made again.

    Parameters
    ----------
    folder : Path
        Where they are kept; must exist.
    *decisive : str
        All that decides their content, such as a plan, a scene's checksum and a version.
    """

    def __init__(self, folder: Path, *decisive: str) -> None:
        self._folder = Path(folder)
        self._decisive = sha256_of("\n".join(decisive).encode())
        self._checksum = self._decisive[:12]

    def path(self, name: str) -> Path:
        """Return where a file is kept: ``inside.csv`` becomes ``inside-<checksum>.csv``."""
        path = self._folder / name
        return path.with_name(f"{path.stem}-{self._checksum}{path.suffix}")

    def find(self, name: str) -> Path | None:
        """Return the path of a file that is kept and undamaged; None where it must be made."""
        path = self.path(name)
        if not path.is_file():
            return None
        try:
            said = read_bytes(_seal_path(path), "checksum").decode()
            if said != self._seal_of(name, read_bytes(path, "kept file")):
                msg = f"{path} is not what was kept there"
                raise DamagedFileError(msg)
        except (FileError, UnicodeDecodeError) as error:  # without a seal it may be anybody's
            _logger.warning("made again: %s", error)
            path.unlink(missing_ok=True)
            return None
        return path

    def keep(self, name: str, data: bytes) -> None:
        """Write a file and its checksum.

        Raises
        ------
        FileError
            If the disk is full or refuses. What was kept before stays.
        """
        write_durably(self.path(name), data)
        self.seal(name)

    def seal(self, name: str) -> None:
        """Write the checksum of a file that was written durably at its `path`.

        Raises
        ------
        FileError
            If it is not there, or the disk refuses.
        """
        path = self.path(name)
        seal = self._seal_of(name, read_bytes(path, "kept file"))
        write_durably(_seal_path(path), seal.encode())

    def _seal_of(self, name: str, data: bytes) -> str:
        """Return the checksum of a file's bytes, its name, and all that decides its content."""
        return sha256_of(f"{self._decisive}\n{name}\n{sha256_of(data)}".encode())


def _seal_path(path: Path) -> Path:
    return path.with_suffix(".sha256")
