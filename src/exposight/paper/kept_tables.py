"""Tables of observations kept from run to run, each beside the checksum of its bytes.

A table is called after a checksum of all that decides it, so that whatever is there under its name
need not be measured again.
"""

from __future__ import annotations

import hashlib
import logging
from typing import TYPE_CHECKING

from exposight.errors import DamagedFileError, FileError, ObservationError
from exposight.files.documents import sha256_of
from exposight.files.durable import write_durably
from exposight.observing import read_observations

if TYPE_CHECKING:
    from pathlib import Path

    from exposight.observing import ObservationTable


_logger = logging.getLogger(__name__)


def table_path(folder: Path, name: str, decisive: tuple[str, ...]) -> Path:
    """Return where a table is kept.

    Parameters
    ----------
    folder : Path
        Of all tables.
    name : str
        What it is, for people.
    decisive : tuple of str
        All that decides its rows.
    """
    checksum = hashlib.sha256("\n".join(decisive).encode()).hexdigest()[:12]
    return folder / f"{name}-{checksum}.parquet"


def kept_table(path: Path) -> ObservationTable | None:
    """Return the table that an earlier run kept; None where it is not there, or was damaged."""
    if not path.is_file():
        return None
    try:
        _check_seal(path)
        return read_observations(path)
    except (FileError, ObservationError) as error:
        _logger.warning("measured again: %s", error)
        path.unlink()
        return None


def seal_table(path: Path) -> None:
    """Write the checksum of a table that is written.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    write_durably(_seal_path(path), sha256_of(path.read_bytes()).encode())


def _check_seal(path: Path) -> None:
    seal = _seal_path(path)
    if not seal.is_file():  # killed between the two; the table itself is whole or absent
        seal_table(path)
        return
    if seal.read_bytes() != sha256_of(path.read_bytes()).encode():
        msg = f"{path}: damaged: its checksum is not that in {seal.name}"
        raise DamagedFileError(msg)


def _seal_path(path: Path) -> Path:
    return path.with_suffix(".sha256")
