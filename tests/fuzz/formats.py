"""What is mutated: a format's samples, its reader, and what must hold of all that it accepts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any


@dataclass(frozen=True)
class Sample:
    """A valid input: the file that is mutated, and what the reader opens.

    Parameters
    ----------
    file : Path
        The file that is mutated.
    opened : Path, optional
        What the reader takes: the file, or the folder that it lies in.
    """

    file: Path
    opened: Path | None = None


@dataclass(frozen=True)
class Format:
    """A format that exposight reads.

    Parameters
    ----------
    name : str
        Such as ``PLY cloud``.
    samples : callable
        Writes valid inputs into an empty folder, and returns them. Small ones: a mutant should take
        milliseconds.
    read : callable
        The public reader. It may raise an `ExposightError`; anything else is a fault of exposight.
    wrong : callable
        Returns what is wrong with a value that was read, which no reader may return: NaN where
        there is no place for it, counts that do not fit, what the writer refuses. Empty: nothing.
    faults : mapping
        Changes that make a sample wrong whatever else holds, by what they are; the reader must
        refuse each. None where a sample has nothing to change so.
    sealed : bool
        Whether the file carries checksums: a reader then refuses all changes, or reads the same.
    reseal : callable, optional
        Returns a mutated file with checksums that are right again (the original, the mutant), so
        that what lies behind them is tried; every other mutant of a sealed format.
    text : bool
        Whether the file is text, or has a header that is.
    same : callable
        Whether two values that were read are the same.
    slow : bool
        A mutant takes more than 0.1 s (a process of its own); a thirtieth as many are tried.
    """

    name: str
    samples: Callable[[Path], Sequence[Sample]]
    read: Callable[[Path], Any]
    wrong: Callable[[Any], str] = lambda _: ""
    faults: Mapping[str, Callable[[bytes, Random], bytes | None]] = field(default_factory=dict)
    sealed: bool = False
    reseal: Callable[[bytes, bytes], bytes] | None = None
    text: bool = True
    same: Callable[[Any, Any], bool] = lambda one, other: repr(one) == repr(other)
    slow: bool = False


def all_formats() -> dict[str, Format]:
    """Return all formats by their names."""
    from tests.fuzz import (
        calibrations_and_poses,
        clouds,
        images,
        meshes,
        own_files,
        own_results,
        plans,
        text_files,
    )

    rooms: Iterable[Sequence[Format]] = (
        calibrations_and_poses.FORMATS,
        clouds.FORMATS,
        images.FORMATS,
        meshes.FORMATS,
        own_files.FORMATS,
        own_results.FORMATS,
        plans.FORMATS,
        text_files.FORMATS,
    )
    return {each.name: each for room in rooms for each in room}
