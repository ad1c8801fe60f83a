"""The numbers of written poses: decimal points or commas, with whatever stands between them."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from exposight.errors import PoseError
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
_BRACKETS = str.maketrans("[](){}", "      ")


def number_rows(text: str) -> list[list[tuple[str, list[float]]]]:
    """Return the ways to read lines of numbers: each a list of lines with a name and numbers.

    A line may begin with a name. There is no way where a word is no number; two where commas may
    be decimal ones or stand between numbers.
    """
    text = _COMMENT.sub("", _NOT_NUMBERS.sub(" ", text)).translate(_BRACKETS)
    lines = [line.strip().strip(",;").strip() for line in text.splitlines()]
    lines = [line for line in lines if line]
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
