"""The exception tree: everything exposight raises on purpose.

Every message says what was expected, what came, and what to do about it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from exposight.contradictions import Contradiction


class ExposightError(Exception):
    """Base of everything exposight raises on purpose."""

    def named(self, message: str) -> Self:
        """Return the error with another message, which says where it came from."""
        return type(self)(message)


class InputError(ExposightError):
    """A value handed in by the caller cannot be right."""


class PoseError(InputError):
    """Not a rigid transform, or a rotation convention that nobody named."""


class FeatureError(InputError):
    """A feature, or a part's list of features, makes no sense."""


class SensorError(InputError):
    """A sensor's description is wrong, or it is asked for an exposure it cannot take."""


class ImageError(InputError):
    """Frames are missing, truncated, differently sized, or of another depth than announced."""


class CloudError(InputError):
    """A point cloud is empty or malformed."""


class ObservationError(InputError):
    """A table of observations cannot be learnt from."""


class ContradictionError(InputError):
    """Two inputs say the same thing twice and do not agree, so no right number can come of them.

    Parameters
    ----------
    message : str
    contradictions : tuple of Contradiction
        What was compared, what was found, and what would explain it; warnings among them.
    """

    def __init__(self, message: str, contradictions: tuple[Contradiction, ...] = ()) -> None:
        super().__init__(message)
        self.contradictions = contradictions

    def named(self, message: str) -> Self:
        """Return the error with another message, which says where it came from."""
        return type(self)(message, self.contradictions)


class AmbiguousError(InputError):
    """Two readings of an input fit equally well, and the caller must say which it is.

    Parameters
    ----------
    message : str
    readings : tuple of str
        The answers that fit, as ``--read-as`` takes them: ``decimal=comma``.
    """

    def __init__(self, message: str, readings: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.readings = readings

    def named(self, message: str) -> Self:
        """Return the error with another message, which says where it came from."""
        return type(self)(message, self.readings)


class FileError(ExposightError):
    """A file or folder on disk cannot be used."""


class MissingFileError(FileError):
    """A file or folder is not there."""


class LockedError(FileError):
    """Another writer has a file or folder open."""


class FormatError(FileError):
    """A file is there and is not what it should be."""


class DamagedFileError(FileError):
    """A file's checksum or length says that it was damaged after it was written."""


class VersionError(FileError):
    """A file was written by a newer version of exposight."""


class NumericalError(ExposightError):
    """Arithmetic cannot go on."""


class NotPositiveDefiniteError(NumericalError):
    """A covariance matrix has no Cholesky factor, even with the largest allowed jitter."""


class OutOfMemoryError(ExposightError):
    """What is asked for takes more memory than the machine has left; nothing was begun."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the known name most like this one, or an empty text."""
    by_lower_case = {each.lower(): each for each in known}
    close = get_close_matches(name.lower(), by_lower_case, n=1)
    return f"; did you mean {by_lower_case[close[0]]!r}?" if close else ""


def first_ten(faults: Sequence[str], between: str = "; ") -> str:
    """Return the first ten of some faults, and how many more there are."""
    more = f" and {len(faults) - 10} more" if len(faults) > 10 else ""
    return between.join(faults[:10]) + more
