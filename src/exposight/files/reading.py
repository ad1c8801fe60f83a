"""Reading files: what is missing, unreadable or damaged is named."""

from __future__ import annotations

from pathlib import Path

from exposight.errors import DamagedFileError, FileError, FormatError, MissingFileError
from exposight.files.documents import sha256_of


def read_bytes(path: Path, what: str) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it is, for messages.

    Raises
    ------
    MissingFileError
        If it is not there.
    FileError
        If the disk refuses.
    """
    try:
        return Path(path).read_bytes()
    except FileNotFoundError as error:
        msg = f"no {what} at {path}"
        raise MissingFileError(msg) from error
    except OSError as error:
        msg = f"{path} cannot be read: {error.strerror or error}; check the disk and permissions"
        raise FileError(msg) from error


def read_text(path: Path, what: str) -> str:
    """Return the content of a text file in UTF-8; see `read_bytes`.

    Raises
    ------
    FormatError
        If it is not UTF-8 text.
    MissingFileError, FileError
        As `read_bytes`.
    """
    try:
        return read_bytes(path, what).decode("utf-8-sig")
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
