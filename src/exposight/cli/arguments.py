"""What several commands check about the files and folders that they write."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exposight.errors import FileError

if TYPE_CHECKING:
    from pathlib import Path


def keep_inputs(output: Path, *inputs: Path | None) -> None:
    """Refuse to write to a file that is read.

    Raises
    ------
    FileError
        If the output is one of the inputs.
    """
    for path in inputs:
        if path is not None and output.exists() and path.exists() and output.samefile(path):
            msg = f"{output} is read by this command and would be replaced; give another --output"
            raise FileError(msg)


def make_folder(folder: Path, what: str) -> None:
    """Make the folder that something shall be written to.

    Raises
    ------
    FileError
        If it cannot be made; the message says what for.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        if folder.is_file():
            reason = "it is a file, and a folder is needed"
        msg = f"{folder} cannot be used for {what}: {reason}"
        raise FileError(msg) from error
