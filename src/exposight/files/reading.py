"""How foreign files are read where they do not tell it themselves, and what was recognised in them.

Readers recognise what they can, say what that was, and ask where two readings fit equally well.
`Reading` is the answer to such questions.
"""

import codecs
import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Self

from exposight.errors import AmbiguousError, InputError, did_you_mean

UNITS_MM: Mapping[str, float] = MappingProxyType({"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4})
"""Units of lengths that files do not tell and people do."""

UNITS_MS: Mapping[str, float] = MappingProxyType({"ms": 1.0, "us": 1e-3, "s": 1e3})
"""Units of exposure times that files do not tell and people do."""

_ANSWERS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "separator": ("comma", "semicolon", "tab", "blank", "pipe"),
        "decimal": ("point", "comma"),
        "encoding": (),
        "unit": tuple(UNITS_MM),
        "size": ("radius", "diameter"),
        "normals": ("outward", "inward"),
        "exposure": tuple(UNITS_MS),
        "angle": ("deg", "rad"),
        "quaternion": ("wxyz", "xyzw"),
    }
)
"""What can be asked, and the answers that there are; any where there are none."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a foreign file is to be read; what is None is recognised, or asked for.

    Parameters
    ----------
    separator : {'comma', 'semicolon', 'tab', 'blank', 'pipe'}, optional
        What stands between the cells of a text table.
    decimal : {'point', 'comma'}, optional
        Decimal separator of a text table.
    encoding : str, optional
        Character encoding of a text table, such as cp1252.
    unit : {'mm', 'cm', 'm', 'inch'}, optional
        Unit of lengths whose column or file does not name it.
    size : {'radius', 'diameter'}, optional
        What the size of a round feature is, where its column does not say.
    normals : {'outward', 'inward'}, optional
        Where the normals of a list of features point; outward unless somebody says otherwise.
    exposure : {'ms', 'us', 's'}, optional
        Unit of exposure times whose column or name does not say it.
    angle : {'deg', 'rad'}, optional
        Unit of angles that does not follow from where they come from.
    quaternion : {'wxyz', 'xyzw'}, optional
        Order of a quaternion's numbers.

    Raises
    ------
    InputError
        If an answer is none of those.
    """

    separator: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    unit: str | None = None
    size: str | None = None
    normals: str | None = None
    exposure: str | None = None
    angle: str | None = None
    quaternion: str | None = None

    def __post_init__(self) -> None:
        for entry in fields(self):
            value, known = getattr(self, entry.name), _ANSWERS[entry.name]
            if value is not None and known and value not in known:
                msg = (
                    f"{entry.name} must be {' or '.join(known)}, got {value!r}"
                    f"{did_you_mean(str(value), known)}"
                )
                raise InputError(msg)
        if self.encoding is not None:
            try:
                codecs.lookup(self.encoding)
            except LookupError as error:
                msg = f"encoding must be one that Python knows, got {self.encoding!r}"
                raise InputError(msg) from error

    @classmethod
    def parse(cls, answers: str) -> Self:
        """Return the reading of a text such as ``decimal=comma,size=diameter``.

        Raises
        ------
        InputError
            If it is no list of questions and answers, or one is not known or there twice.
        """
        known = tuple(_ANSWERS)
        given: dict[str, str] = {}
        for word in filter(None, (each.strip() for each in answers.split(","))):
            name, equals, value = word.partition("=")
            if not equals or name.strip() not in known:
                msg = (
                    f"a reading is written as NAME=ANSWER, NAME one of {', '.join(known)}, got "
                    f"{word!r}{did_you_mean(name, known)}"
                )
                raise InputError(msg)
            if name.strip() in given:
                msg = f"the reading says {name.strip()} twice"
                raise InputError(msg)
            given[name.strip()] = value.strip()
        return cls(**given)

    def over(self, other: "Reading") -> "Reading":
        """Return this reading, and of `other` what this one leaves open."""
        said = {e.name: getattr(self, e.name) for e in fields(self)}
        return replace(other, **{name: value for name, value in said.items() if value is not None})


_NOTHING_SAID = Reading()
_current: ContextVar[Reading] = ContextVar("_current", default=_NOTHING_SAID)


@contextmanager
def reading_as(reading: Reading) -> Iterator[None]:
    """Let readers within a ``with`` block take these answers where they are given none."""
    token = _current.set(reading.over(_current.get()))
    try:
        yield
    finally:
        _current.reset(token)


def current_reading(given: Reading | None = None) -> Reading:
    """Return what a caller gave, and where that is open what `reading_as` says around it."""
    return (given or Reading()).over(_current.get())


def ambiguous(
    source: str | Path, question: str, name: str, answers: Mapping[str, str]
) -> Exception:
    """Return the error of an input that two readings fit equally well, to be raised.

    Parameters
    ----------
    source : str or Path
        What was read.
    question : str
        What is not known: "is 1,234 a decimal number or in thousands?".
    name : str
        The entry of `Reading` that answers it.
    answers : mapping of str to str
        Each answer that fits, and what the input would be then.
    """
    fits = "; ".join(f"{name}={answer} ({meaning})" for answer, meaning in answers.items())
    msg = (
        f"{source}: {question} Both readings fit, so say which it is: --read-as {fits} (in Python "
        f"Reading({name}=…))"
    )
    return AmbiguousError(msg, tuple(f"{name}={answer}" for answer in answers))


_logger = logging.getLogger("exposight.recognised")


def recognised(source: str | Path, *remarks: str) -> None:
    """Say what was recognised in a file: a message at level INFO that commands show."""
    if remarks:
        _logger.info("%s: %s", source, ", ".join(remarks))


class _Collector(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.remarks: dict[str, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        self.remarks[record.getMessage()] = None


@contextmanager
def collected_remarks() -> Iterator[dict[str, None]]:
    """Collect what is `recognised` within a ``with`` block, each remark once and in order."""
    collector, level = _Collector(), _logger.level
    _logger.addHandler(collector)
    _logger.setLevel(logging.INFO)
    try:
        yield collector.remarks
    finally:
        _logger.removeHandler(collector)
        _logger.setLevel(level)
