"""Values of calibration files and texts: numbers, printed matrices, announced ones, headings."""

import re
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError

LARGEST_BYTES = 5_000_000
"""Larger files are no calibrations."""
DEEPEST = 30

Tree: TypeAlias = dict[str, "Tree"] | list["Tree"] | NDArray[np.float64] | float | str
"""Maps, lists, arrays, numbers, text."""

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|[-+]?\.?(?:nan|inf(?:inity)?)"
_IS_NUMBER = re.compile(_NUMBER, re.IGNORECASE)
_NUMBERS = (
    rf"[\s\[\](,;|]*(?:{_NUMBER})(?:[\s\[\]),;|]+(?:{_NUMBER}))*[\s\[\]),;|]*"  # with brackets
)
IS_PRINTED = re.compile(rf"(?:array\()?{_NUMBERS}", re.IGNORECASE)


class SyntaxFault(FormatError):
    """A file that cannot be parsed; the message says why, and has no path."""


def scalar(text: str) -> Tree:
    """Return a number, a printed matrix, or the text itself."""
    text = text.strip().removesuffix(";").rstrip()  # MATLAB ends lines so
    if _IS_NUMBER.fullmatch(text):
        return _float(text)
    if len(text) < 3 or not IS_PRINTED.fullmatch(text):
        return text
    bare = text.removeprefix("array(")
    rows = [re.findall(_NUMBER, row, re.IGNORECASE) for row in re.split(r"[\];\n]", bare)]
    numbers = [[_float(each) for each in row] for row in rows if row]
    if len(numbers) == 1 or len({len(row) for row in numbers}) != 1:
        return np.array([each for row in numbers for each in row])
    return np.array(numbers)


def _float(text: str) -> float:
    return float(text.lower().replace(".nan", "nan").replace(".inf", "inf"))


def _matrix(
    rows: int, columns: int, data: NDArray[np.float64], name: str, *, typed: bool
) -> NDArray[np.float64]:
    """Return numbers in rows and columns.

    Releases of ROS, whose matrices have no type, announce 5 where they write 8 coefficients.
    """
    data = data.reshape(-1)
    if not typed and (rows, columns) == (1, 5) and data.size in {8, 12, 14}:
        return data.reshape(1, -1)
    if rows * columns != data.size:
        msg = f"'{name}' announces {rows} × {columns} numbers and has {data.size}; was it cut off?"
        raise SyntaxFault(msg)
    return data.reshape(rows, columns)


def as_numbers(value: object) -> NDArray[np.float64] | None:
    """Return nested lists of numbers as an array; None for anything else."""
    if isinstance(value, np.ndarray):
        return np.asarray(value, dtype=np.float64)
    if not isinstance(value, list):
        return None
    parts = [as_numbers(each) if isinstance(each, list | np.ndarray) else each for each in value]
    if all(isinstance(each, float) for each in parts):
        return np.array(parts, dtype=np.float64)
    arrays = [each for each in parts if isinstance(each, np.ndarray)]
    if len(arrays) != len(parts) or len({each.shape for each in arrays}) != 1:
        return None
    return np.stack(arrays)


def settled(value: Any, name: str, depth: int = 0) -> Tree:
    """Return what a parser gave as a tree: matrices as arrays, text of numbers as numbers."""
    if depth > DEEPEST:
        msg = f"it is nested more than {DEEPEST} deep"
        raise SyntaxFault(msg)
    if isinstance(value, Mapping):
        if (matrix := _announced(value, name, depth)) is not None:
            return matrix
        return {str(key): settled(each, str(key), depth + 1) for key, each in value.items()}
    if isinstance(value, list | tuple):
        parts = [settled(each, name, depth + 1) for each in value]
        if len(parts) == 1 and isinstance(parts[0], np.ndarray) and isinstance(value[0], str):
            return parts[0]  # [0.1 0.2 0.3]: numbers without commas
        numbers = as_numbers(parts)
        return parts if numbers is None else numbers
    if isinstance(value, bool) or value is None:
        return str(value)
    if isinstance(value, int | float):
        return float(value)
    if isinstance(value, str):
        return scalar(value)
    return str(value)


def _announced(value: Mapping[str, Any], name: str, depth: int) -> NDArray[np.float64] | None:
    """Return the matrix of a map of rows, cols (or sizes) and data; None where it is none."""
    lower = {str(key).lower(): each for key, each in value.items()}
    if "data" not in lower or not ({"rows", "cols"} <= set(lower) or "sizes" in lower):
        return None
    data = as_numbers(settled(lower["data"], name, depth + 1))
    if data is None:
        single = settled(lower["data"], name, depth + 1)
        if not isinstance(single, float):
            msg = f"'{name}' is no matrix of numbers"
            raise SyntaxFault(msg)
        data = np.array([single])
    if "sizes" in lower:
        listed = settled(lower["sizes"], name)
        sizes = as_numbers(listed if isinstance(listed, list | np.ndarray) else [listed])
        if sizes is None or not sizes.size:
            msg = f"'{name}' announces {lower['sizes']!r} rows and columns"
            raise SyntaxFault(msg)
        shape = np.array([_whole(each, name) for each in sizes.reshape(-1)], dtype=float)
    else:
        shape = np.array([_whole(lower["rows"], name), _whole(lower["cols"], name)], dtype=float)
    channels = re.fullmatch(r"(\d*)[a-z]", str(lower.get("dt", "d")))
    if channels is None:
        msg = f"'{name}' is of the type {lower['dt']!r}; expected one kind of number, such as d"
        raise SyntaxFault(msg)
    if channels[0].endswith("f"):  # written, and read by OpenCV, in single precision
        data = data.astype(np.float32).astype(np.float64)
    if shape.size == 1:
        shape = np.append(shape, 1.0)
    columns = int(np.prod(shape[1:])) * int(channels[1] or 1)
    return _matrix(int(shape[0]), columns, data, name, typed="dt" in lower)


def _whole(value: object, name: str) -> int:
    number = scalar(str(value))
    if not isinstance(number, float) or number != int(number) or not 0 <= number <= 1e6:
        msg = f"'{name}' announces {value!r} rows or columns"
        raise SyntaxFault(msg)
    return int(number)


_NAME = re.compile(r"[A-Za-z_][\w .()/-]*")
_LONGEST = 20
"""Lines of a printed array."""
_SECTION = re.compile(r"\s*\[\s*([A-Za-z_][^\]]*?)\s*\]\s*")


def parse_text(text: str) -> dict[str, Tree]:
    """Parse lines of numbers under headings, ``name=value`` lines, and ``[sections]``."""
    tree: dict[str, Tree] = {}
    for section, name, lines in _blocks(text):
        value = _block_value(lines)
        where = tree
        if section:
            inner = tree.setdefault(section, {})
            assert isinstance(inner, dict)
            where = inner
        if name in where:
            msg = f"'{name}' is there twice; keep one camera's part, or put each under a [heading]"
            raise SyntaxFault(msg)
        where[name] = value
    return tree


def _blocks(text: str) -> Iterator[tuple[str, str, list[str]]]:
    """Yield section, name and lines of each value; sections that come again are numbered."""
    section, name, lines, unnamed = "", "", list[str](), 0
    sections: dict[str, int] = {}
    for line in [*_joined_lines(text), ""]:
        if _is_numeric(line):
            if lines and not name and _count(line) != _count(lines[-1]):
                unnamed += 1
                yield section, f"matrix{unnamed}", lines
                lines = []
            lines.append(line)
            continue
        if lines:
            unnamed += not name
            yield section, name or f"matrix{unnamed}", lines
            name, lines = "", []
        if (found := _SECTION.fullmatch(line)) is not None:
            count = sections[found[1]] = sections.get(found[1], 0) + 1
            section, name = found[1] if count == 1 else f"{found[1]} {count}", ""
        elif (pair := re.split("[=:]", line, maxsplit=1))[-1].strip() and len(pair) == 2:
            if _NAME.fullmatch(pair[0].strip()):
                yield section, pair[0].strip(), [pair[1].strip()]
        elif line:
            name = line.rstrip(":= ")


def _is_numeric(line: str) -> bool:
    return bool(line) and IS_PRINTED.fullmatch(line) is not None


def _joined_lines(text: str) -> Iterator[str]:
    """Yield lines without comments; a printed array that begins after a name is one."""
    begun: list[str] = []
    has_arrays = "array(" in text
    for raw in text.splitlines():
        line = raw.partition("#")[0].partition("%")[0].strip().removeprefix("//").strip()
        if has_arrays:
            line = re.sub(r"(?:np\.|numpy\.)?array\(|,\s*dtype=[\w.]+|\)\s*[,;]?$", "", line)
        begun.append(line)
        whole = "\n".join(begun)
        is_open = whole.count("[") > whole.count("]") and re.search(r"[=:]\s*\[", begun[0])
        if not is_open or len(begun) > _LONGEST:
            yield from [whole] if len(begun) <= _LONGEST else begun
            begun = []
    yield from begun


def _count(line: str) -> int:
    return len(re.findall(r"[^\s,;|\[\]()]+", line))


def _block_value(lines: list[str]) -> Tree:
    joined = "\n".join(lines)
    if "." not in joined and re.search(r"\d,\d", joined) and re.search(r"[;\t]|\d +-?\d", joined):
        joined = joined.replace(",", ".")  # 2210,5;0;811,25
    return scalar(joined.replace("|", " "))
