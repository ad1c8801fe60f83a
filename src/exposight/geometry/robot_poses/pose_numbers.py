"""The numbers of written poses: decimal points or commas, and the units of lengths and angles."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight.errors import AmbiguousError, PoseError
from exposight.files import ambiguous, current_reading

NUMBER = r"[-+]?(?:\d+(?:[.,]\d+)?|[.,]\d+|\d+\.)(?:[eE][-+]?\d+)?(?!\.?,?\d)"
"""A number in a text where commas may be decimal ones."""

_POINT = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
_COMMA = re.compile(r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+")


def numbers_of(words: Sequence[str], source: str | Path) -> list[float]:
    """Return numbers whose commas, where they have some, are decimal ones.

    Raises
    ------
    PoseError
        If commas and points are mixed.
    AmbiguousError
        If the commas could stand between thousands as well.
    """
    commas = [word for word in words if "," in word]
    if not commas:
        return [float(word) for word in words]
    decimal = current_reading().decimal
    thousands = all(map(_THOUSANDS.fullmatch, commas))
    if decimal == "point" and thousands:
        return [float(word.replace(",", "")) for word in words]
    if decimal == "point" or any("." in word for word in words):
        msg = f"{source}: commas and points are mixed in the numbers, as in {commas[0]!r}"
        raise PoseError(msg)
    if thousands and decimal is None:
        raise ambiguous(
            source,
            f"is {commas[0]} a number with decimals, or of thousands?",
            "decimal",
            {
                "comma": commas[0].replace(",", "."),
                "point": commas[0].replace(",", ""),
            },
        )
    return [float(word.replace(",", ".")) for word in words]


_NOT_NUMBERS = re.compile(
    r"\b(?:np\.|numpy\.)?(?:array|asarray|matrix|tensor|Matrix4x4|Pose|SE3)\s*\("
    r"|,?\s*dtype\s*=\s*[\w.]+"
)
_COMMENT = re.compile(r"^\s*(?:#|%|//|!).*$", re.MULTILINE)
_LONGEST_LINE = 2000
_BRACKETS = str.maketrans("[](){}", "      ")


def number_rows(text: str) -> list[list[tuple[str, list[float]]]]:
    """Return the ways to read lines of numbers: each a list of lines with a name and numbers.

    A line may begin with a name. There is no way where a word is no number; two where commas may
    be decimal ones or stand between numbers.
    """
    text = _COMMENT.sub("", _NOT_NUMBERS.sub(" ", text)).translate(_BRACKETS)
    lines = [line.strip().strip(",;").strip() for line in text.splitlines()]
    lines = [line for line in lines if line]
    if any(len(line) > _LONGEST_LINE for line in lines):  # no row of numbers; it would take long
        return []
    ways = [(_points, "point"), (_decimal_commas, "comma"), (_comma_pairs, "comma")]
    decimal = current_reading().decimal
    read: list[list[tuple[str, list[float]]]] = []
    for way, kind in ways:
        if kind != "point" and "," not in text:
            continue
        if decimal is not None and kind != decimal and "," in text:
            continue
        rows = [_row(line, way) for line in lines]
        found = [row for row in rows if row is not None]
        if found and len(found) == len(rows) and found not in read:
            read.append(found)
    return read


def _row(line: str, way: Callable[[str], list[float] | None]) -> tuple[str, list[float]] | None:
    named = re.match(r"([A-Za-z_$][\w$.\-]*(?:\[[\w: ]*\])?)\s*[:=;,\s]\s*(?=[-+.\d])", line)
    rest = line[named.end() :] if named else line
    numbers = way(rest.strip())
    return None if numbers is None else (named.group(1) if named else "", numbers)


def _points(line: str) -> list[float] | None:
    words = re.split(r"[\s,;|]+", line)
    return [float(w) for w in words] if all(map(_POINT.fullmatch, words)) else None


def _decimal_commas(line: str) -> list[float] | None:
    if ";" in line or "|" in line or "\t" in line:
        words = re.split(r"\s*[;|\t]\s*", line)
    else:
        words = re.split(r",?\s+", line)
    if len(words) < 2 or not all(map(_COMMA.fullmatch, words)):
        return None
    return [float(word.replace(",", ".")) for word in words]


def _comma_pairs(line: str) -> list[float] | None:
    words = re.split(r"\s*,\s*", line)
    if len(words) % 2 or len(words) < 12:
        return None
    pairs = [f"{a}.{b}" for a, b in zip(words[::2], words[1::2], strict=True) if b.isdigit()]
    if len(pairs) * 2 < len(words) or not all(map(_POINT.fullmatch, pairs)):
        return None
    return [float(pair) for pair in pairs]


UNIT_MM: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}

_MOST_M = 10.0
"""No robot's arm reaches farther: such a position is in mm."""


_MOST_DEG = 3600.0


def checked_metres(position_m: Sequence[float], what: str) -> NDArray[np.float64]:
    """Return a position in m, within a robot's reach.

    Raises
    ------
    AmbiguousError
        If it is not, and can only be in mm.
    """
    position = np.asarray(position_m, dtype=np.float64)
    if float(np.abs(position).max()) > _MOST_M:
        msg = (
            f"{what} has its position in m, and {float(np.abs(position).max()):g} m is out of any "
            "robot's reach: if it is in mm, say so: --read-as unit=mm"
        )
        raise AmbiguousError(msg, ("unit=mm",))
    return position


def metres_of(position: Sequence[float]) -> list[float]:
    """Return a position that is in m unless `Reading.unit` says that it is in mm."""
    scale = 0.001 if current_reading().unit == "mm" else 1.0
    return [scale * number for number in position]


def radians_of(angles: Sequence[float]) -> list[float]:
    """Return angles that are in rad unless `Reading.angle` says otherwise."""
    turn = math.pi / 180.0 if current_reading().angle == "deg" else 1.0
    return [turn * angle for angle in angles]


def degrees_of(angles: Sequence[float]) -> list[float]:
    """Return angles that are in degrees unless `Reading.angle` says otherwise.

    Raises
    ------
    PoseError
        If one turns round more than ten times.
    """
    turn = 180.0 / math.pi if current_reading().angle == "rad" else 1.0
    degrees = [turn * angle for angle in angles]
    for angle in degrees:
        if not abs(angle) <= _MOST_DEG:
            msg = f"an angle of {angle:g}°; angles of at most {_MOST_DEG:g}° are read"
            raise PoseError(msg)
    return degrees


def angle_remark(angles: Sequence[float]) -> str:
    """Return what to check where angles of no said unit look like radians; mostly empty."""
    whole = all(float(angle).is_integer() for angle in angles)
    if current_reading().angle is not None or whole or max(map(abs, angles)) > 2 * math.pi:
        return ""
    return "no angle is beyond ±2π, yet they are read as degrees (radians: --read-as angle=rad)"


def vector_radians(vector: Sequence[float]) -> NDArray[np.float64]:
    """Return a rotation vector that turns by one full turn at most, rad.

    Raises
    ------
    PoseError
        If it turns by more.
    """
    checked = np.asarray(vector, dtype=np.float64)
    turn = float(np.linalg.norm(checked))
    if turn > 2.0 * math.pi + 1e-6:
        msg = (
            f"a rotation vector of length {turn:g} turns by more than 2π; it is in radians: "
            "multiply degrees by π/180 (--read-as angle=deg)"
        )
        raise PoseError(msg)
    return checked
