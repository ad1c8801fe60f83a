"""The characters of a text file: which encoding its bytes are in."""

import codecs
from pathlib import Path

from exposight.errors import FormatError

_MARKS = (  # UTF-32 first: its mark begins with that of UTF-16
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

_SHOWN = {
    "utf-16-le": "UTF-16",
    "utf-16-be": "UTF-16",
    "utf-32-le": "UTF-32",
    "utf-32-be": "UTF-32",
}

_EXAMINED = 4096
"""Bytes of a file in which zeros tell that each character takes two or four."""


def decode(data: bytes, source: str | Path, encoding: str | None = None) -> tuple[str, str]:
    """Return the text of a file's bytes, and its encoding.

    UTF-8, UTF-16 and UTF-32 are recognised, with and without their mark; what is none of them is
    taken as cp1252, which Windows writes in western Europe.

    Parameters
    ----------
    data : bytes
    source : str or Path
        For messages.
    encoding : str, optional
        What somebody says that it is.

    Returns
    -------
    text : str
        Without the mark.
    encoding : str
        As Python names it.

    Raises
    ------
    FormatError
        If the bytes are not in the encoding, or are no text.
    """
    name = encoding or recognise_encoding(data)
    guessed = recognise_encoding(data)
    if name.lower() in {"utf-16", "utf16", "utf-32", "utf32"} and guessed.startswith("utf"):
        name = guessed if guessed != "utf-8" else name  # which order its bytes have
    marks = ((mark, own) for mark, own in _MARKS if data.startswith(mark) and _same(own, name))
    mark, codec = next(marks, (b"", name))
    try:
        text = data[len(mark) :].decode(codec)
    except UnicodeDecodeError as error:
        told = f"it is not {name}" if encoding else "no encoding was recognised"
        msg = (
            f"{source}: {told} (byte {error.start}: {error.reason}); save it as UTF-8, or say its "
            "encoding: --read-as encoding=…"
        )
        raise FormatError(msg) from error
    if "\0" in text:
        msg = f"{source} holds zeros, so it is no text file; expected a text table"
        raise FormatError(msg)
    return text, name


def _same(mark: str, name: str) -> bool:
    plain = name.lower().replace("_", "-")
    return plain in {mark, mark.removesuffix("-le").removesuffix("-be"), f"{mark}-sig"}


def recognise_encoding(data: bytes) -> str:
    """Return the encoding that a file's bytes seem to be in, as Python names it."""
    for mark, name in _MARKS:
        if data.startswith(mark):
            return name
    start = data[:_EXAMINED]
    zeros = [start[offset::4].count(0) for offset in range(4)]
    quarter = max(len(start) // 4, 1)
    if sum(zeros) and len(data) % 2 == 0:
        if len(data) % 4 == 0 and min(zeros[2], zeros[3]) >= 0.99 * quarter:
            return "utf-32-le"
        if len(data) % 4 == 0 and min(zeros[0], zeros[1]) >= 0.99 * quarter:
            return "utf-32-be"
        if zeros[1] + zeros[3] > quarter and not zeros[0] + zeros[2]:
            return "utf-16-le"
        if zeros[0] + zeros[2] > quarter and not zeros[1] + zeros[3]:
            return "utf-16-be"
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def encoding_remark(encoding: str, *, given: bool = False) -> str:
    """Return what to say of an encoding; nothing of UTF-8."""
    if encoding in {"utf-8", "ascii"}:
        return ""
    if encoding == "cp1252" and not given:
        return "characters as Windows writes them (cp1252), for it is not UTF-8"
    return f"characters in {_SHOWN.get(encoding, encoding)}"
