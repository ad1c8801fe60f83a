"""TOML that others wrote: parsed in linear time, or refused."""

import re
import tomllib
from pathlib import Path
from typing import Any

from exposight.errors import FormatError
from exposight.files.foreign import parsing

_MOST_PARTS = 100
"""Names in one dotted key; the parser's time and memory grow with the square of their number."""

# Strings that are not ended go on to the end of the line or file, so that each is looked at once.
_TEXTS = re.compile(
    r'"""(?:\\.|[^\\"]|"(?!""))*+(?:"""|\Z)|'
    r"'''(?:[^']|'(?!''))*+(?:'''|\Z)|"
    r'"(?:\\.|[^"\\\n])*+"?|'
    r"'[^'\n]*+'?|"
    r"\#[^\n]*+",
    re.DOTALL,
)
_MANY_PARTS = re.compile(rf"(?:\.[^.,=\[\]{{}}\n]*+){{{_MOST_PARTS}}}")


def parse_toml(text: str, source: Path | str, what: str) -> dict[str, Any]:
    """Return the keys and values in a TOML document.

    Parameters
    ----------
    text : str
        The document.
    source : Path or str
        Where it comes from, for messages.
    what : str
        What it should be, for messages: ``scene in TOML``.

    Raises
    ------
    FormatError
        If it is not TOML, has a key twice, or is nested too deeply.
    """
    with parsing(source, what):
        if _MANY_PARTS.search(_TEXTS.sub("s", text)):
            msg = f"{source} is not a readable {what}: a key has {_MOST_PARTS} dots or more"
            raise FormatError(msg)
        try:
            return tomllib.loads(text)
        except ValueError as error:  # broken, or a number of thousands of digits
            msg = f"{source} is not a readable {what}: {error}"
            raise FormatError(msg) from error
