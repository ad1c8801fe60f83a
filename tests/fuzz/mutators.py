"""Changes to files that nobody means well with: of bytes, of text, of numbers in either.

Each takes the content and a seeded random generator and returns other content, so that a mutant is
told by the format's name and a number, and made again from them.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from random import Random
from typing import TypeAlias

Mutator: TypeAlias = Callable[[bytes, Random], bytes]

_LARGEST = 50_000_000
"""Bytes of a mutant; the small file that eats the machine is the danger, not the large one."""

_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_]{2,}")
_ODD_NUMBERS = (
    b"-1", b"0", b"-0", b"1e999", b"-1e308", b"nan", b"inf", b"-inf", b"1e-320", b"2147483648",
    b"4294967295", b"9223372036854775808", b"99999999999999999999999", b"0x10", b"1_000", b"1,5",
    b'"1"', b"1j", b"1+2j", b"", b"null", b"true", b"[]", b"{}", b"1e9", b"100000000", b"--1",
)  # fmt: skip
_ODD_WORDS = (
    b"", b"\x1b[31m", b"\x00", b"\xff\xfe", b"=1+1", b"A" * 300, b"../../x",
    b"\xef\xbb\xbf", b"\xe2\x80\xae", b"1.2.3",
    b"%s%n", b"{}", b"'", b'"', b"\r", b"NaN", b"true", b"\xf0\x9f\x92\xa9",
)  # fmt: skip
_EXTREMES = tuple(
    struct.pack(form, value)
    for form, values in {
        "<i": (0, -1, 1, 2**31 - 1, -(2**31)),
        ">i": (1, 2**31 - 1, -(2**31)),
        "<q": (-1, 2**63 - 1, -(2**63), 2**40),
        "<f": (float("nan"), float("inf"), -1.0, 3e38),
        "<d": (float("nan"), float("inf"), -1.0, 1e308),
        "<H": (0, 0xFFFF, 0x8000),
    }.items()
    for value in values
)


def _place(data: bytes, random: Random) -> int:
    """Return a position; every other one among the first bytes, where headers are."""
    return random.randrange(min(len(data), 400) if random.random() < 0.5 else len(data))


def _flip(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 8))):
        changed[_place(data, random)] ^= 1 << random.randrange(8)
    return bytes(changed)


def _set(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(random.choice((1, 1, 4, 16))):
        changed[_place(data, random)] = random.randrange(256)
    return bytes(changed)


def _extreme(data: bytes, random: Random) -> bytes:
    word, place = random.choice(_EXTREMES), _place(data, random)
    return data[:place] + word + data[place + len(word) :]


def _cut_off(data: bytes, random: Random) -> bytes:
    return data[: _place(data, random)]


def _delete(data: bytes, random: Random) -> bytes:
    place = _place(data, random)
    return data[:place] + data[place + random.choice((1, 2, 4, 16, 100, 1000)) :]


def _insert(data: bytes, random: Random) -> bytes:
    place = _place(data, random)
    return data[:place] + random.randbytes(random.choice((1, 2, 4, 16, 100))) + data[place:]


def _repeat(data: bytes, random: Random) -> bytes:
    place = _place(data, random)
    piece = data[place : place + random.choice((1, 4, 16, 64, 256))]
    times = random.choice((1, 1, 1, 2, 10, 1000))
    return data[:place] + piece * times + data[place:]


def _exchange(data: bytes, random: Random) -> bytes:
    one, other = sorted((_place(data, random), _place(data, random)))
    size = min(random.choice((1, 4, 16, 64)), other - one)
    return (
        data[:one]
        + data[other : other + size]
        + data[one + size : other]
        + data[one : one + size]
        + data[other + size :]
    )


def _append(data: bytes, random: Random) -> bytes:
    return data + random.choice((b"\0", b"\n", b"\xff" * 64, random.randbytes(100), data[:1000]))


def _empty(data: bytes, random: Random) -> bytes:
    return random.choice((b"", b"\n", b" ", b"\0", b"\xef\xbb\xbf", b"\0" * 1000))


BYTES: tuple[Mutator, ...] = (
    _flip, _set, _extreme, _cut_off, _delete, _insert, _repeat, _exchange, _append, _empty,
)  # fmt: skip


def _replaced(pattern: re.Pattern[bytes], odd: tuple[bytes, ...]) -> Mutator:
    def mutate(data: bytes, random: Random) -> bytes:
        found = list(pattern.finditer(data[:200_000]))
        if not found:
            return _flip(data, random)
        one = found[random.randrange(min(len(found), 60) if random.random() < 0.5 else len(found))]
        return data[: one.start()] + random.choice(odd) + data[one.end() :]

    return mutate


def _lines(data: bytes, random: Random) -> bytes:
    lines = data.splitlines(keepends=True)
    one, other = random.randrange(len(lines)), random.randrange(len(lines))
    match random.randrange(5):
        case 0:
            del lines[one]
        case 1:
            lines.insert(other, lines[one])
        case 2:
            lines[one], lines[other] = lines[other], lines[one]
        case 3:
            times = min(random.choice((2, 100, 20_000)), 2 + _LARGEST // max(len(lines[one]), 1))
            lines[one : one + 1] = [lines[one]] * times
        case _:
            lines[one] = lines[one][: random.randrange(len(lines[one]) + 1)]
    return b"".join(lines)


def _marks(data: bytes, random: Random) -> bytes:
    """Change one separator, bracket or quotation mark."""
    marks = [place for place, byte in enumerate(data[:200_000]) if byte in b",;:=<>[]{}()\"'\t|"]
    if not marks:
        return _set(data, random)
    place = random.choice(marks)
    return (
        data[:place] + random.choice((b"", b",", b";", b'"', b"[", b"}", b"\t")) + data[place + 1 :]
    )


def _nest(data: bytes, random: Random) -> bytes:
    place, depth = _place(data, random), random.choice((10, 1000, 100_000))
    return (
        data[:place]
        + random.choice((b"[", b"{", b'{"a":', b"(", b"<a>", b"- ")) * depth
        + data[place:]
    )


def _encode(data: bytes, random: Random) -> bytes:
    text = data.decode("utf-8", errors="replace")
    encoding = random.choice(("utf-16", "utf-32", "utf-8-sig", "cp500", "latin-1"))
    return text.encode(encoding, errors="replace")


TEXT: tuple[Mutator, ...] = (
    *[_replaced(_NUMBER, _ODD_NUMBERS)] * 2, _replaced(_WORD, _ODD_WORDS), _lines, _lines, _marks,
    _nest, _encode,
)  # fmt: skip


def mutated(data: bytes, random: Random, *, text: bool) -> bytes:
    """Return the content after one change, sometimes after two or three.

    Parameters
    ----------
    data : bytes
    random : Random
    text : bool
        Whether the file is text, or has a header that is.
    """
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        if not data:
            break
        mutators = TEXT if text and random.random() < 0.65 else BYTES
        data = random.choice(mutators)(data, random)[:_LARGEST]
    return data
