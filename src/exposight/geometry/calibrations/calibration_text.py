"""Calibrations as plain text: numbers under headings, ``name=value`` lines, ``[sections]``."""

import re
from collections.abc import Iterator

from exposight.geometry.calibrations.calibration_values import IS_PRINTED, SyntaxFault, Tree, scalar

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
    for raw in text.splitlines():
        line = raw.partition("#")[0].partition("%")[0].strip().removeprefix("//").strip()
        if "array(" in text:
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
