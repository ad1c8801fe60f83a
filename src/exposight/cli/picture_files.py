"""Pictures that commands write: PNG or SVG by the name's end."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from exposight.cli.app import UsageError
from exposight.files import write_durably

if TYPE_CHECKING:
    from exposight.report.figures import Still


def check_picture(path: Path) -> None:
    """Check that a picture's name says what it is to be.

    Raises
    ------
    UsageError
        If it ends in neither .png nor .svg.
    """
    if path.suffix.lower() not in {".png", ".svg"}:
        msg = f"--picture writes PNG or SVG; got the name {path.name}"
        raise UsageError(msg)


def write_picture(path: Path, still: Still) -> None:
    """Write a picture durably."""
    write_durably(path, still.png if path.suffix.lower() == ".png" else still.svg)
