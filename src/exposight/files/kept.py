"""Finished pieces of long work, kept by checksum so that an interrupted work continues."""

from __future__ import annotations

import logging
from pathlib import Path

from exposight.errors import FileError
from exposight.files.documents import sha256_of
from exposight.files.durable import write_durably
from exposight.files.reading import read_bytes, read_verified

_logger = logging.getLogger(__name__)


class KeptFiles:
    """Files in a folder that need not be made again while all that decides them is the same.

    A file's name carries a checksum of what decides its content, so that a file which other inputs
    made is never taken for this one. Beside each lies the SHA-256 of its bytes; a file that was
    damaged is removed when it is looked up, and made again.

    Parameters
    ----------
    folder : Path
        Where they are kept; must exist.
    *decisive : str
        All that decides their content, such as a plan, a scene's checksum and a version.
    """

    def __init__(self, folder: Path, *decisive: str) -> None:
        self._folder = Path(folder)
        self._checksum = sha256_of("\n".join(decisive).encode())[:12]

    def path(self, name: str) -> Path:
        """Return where a file is kept: ``inside.csv`` becomes ``inside-<checksum>.csv``."""
        path = self._folder / name
        return path.with_name(f"{path.stem}-{self._checksum}{path.suffix}")

    def find(self, name: str) -> Path | None:
        """Return the path of a file that is kept and undamaged; None where it must be made."""
        path = self.path(name)
        if not path.is_file():
            return None
        if not _seal_path(path).is_file():  # killed between the two; the file itself is whole
            self.seal(name)
            return path
        try:
            read_verified(path, read_bytes(_seal_path(path), "checksum").decode(), "kept file")
        except (FileError, UnicodeDecodeError) as error:
            _logger.warning("made again: %s", error)
            path.unlink()
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
        write_durably(_seal_path(path), sha256_of(read_bytes(path, "kept file")).encode())


def _seal_path(path: Path) -> Path:
    return path.with_suffix(".sha256")
