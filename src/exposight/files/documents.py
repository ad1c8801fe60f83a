"""JSON documents with a format name, a version and strict keys."""

from __future__ import annotations

import hashlib
import json
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from exposight.errors import DamagedFileError, FormatError, VersionError
from exposight.files.document_faults import faults, written


class StrictDocument(BaseModel):
    """A JSON object whose keys are all known and whose values have exactly their types."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


_Document = TypeVar("_Document", bound=StrictDocument)


def parse_json(text: str, source: str) -> dict[str, Any]:
    """Return the JSON object in a text.

    Raises
    ------
    FormatError
        If it is no JSON, or no object; the message names the source.
    """
    try:
        raw = json.loads(text)
    except json.JSONDecodeError as error:
        msg = f"{source} is not JSON (line {error.lineno}: {error.msg}); was it cut off?"
        raise FormatError(msg) from error
    if not isinstance(raw, dict):
        msg = f"{source} must hold a JSON object, got {type(raw).__name__}"
        raise FormatError(msg)
    return raw


def check_header(raw: dict[str, Any], *, format_name: str, newest: int, source: str) -> None:
    """Check a document's format name and version, before anything else in it is looked at.

    Raises
    ------
    FormatError
        If it is another kind of document.
    VersionError
        If a newer version of exposight wrote it.
    """
    found = raw.get("format")
    if found != format_name:
        got = "and it is missing" if found is None else f"got {written(found)}"
        msg = (
            f"{source}: key 'format' must be \"{format_name}\", {got}; is it another kind of file?"
        )
        raise FormatError(msg)
    version = raw.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        known = "1" if newest == 1 else f"a whole number from 1 to {newest}"
        got = "and it is missing" if version is None else f"got {written(version)}"
        msg = f"{source}: key 'version' must be {known}, {got}"
        raise FormatError(msg)
    if version > newest:
        msg = (
            f"{source} has version {version} of the format {format_name!r}; this exposight reads "
            f"up to version {newest}: update exposight"
        )
        raise VersionError(msg)


def validate(model: type[_Document], text: str, source: str) -> _Document:
    """Return a JSON text as a typed document.

    Raises
    ------
    FormatError
        If a key is missing or unknown or a value has the wrong type; the message names
        each key as the file has it.
    """
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        msg = f"{source}: {faults(error, json.loads(text))}"
        raise FormatError(msg) from error


def sha256_of(data: bytes) -> str:
    """Return the SHA-256 checksum of bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def sealed_json(document: StrictDocument) -> bytes:
    """Return a document as JSON with a checksum of itself under the key ``sha256``."""
    content = document.model_dump(mode="json")
    return json.dumps(
        {**content, "sha256": _seal(content)}, indent=2, ensure_ascii=False, allow_nan=False
    ).encode()


def unseal_json(
    model: type[_Document], data: bytes, *, format_name: str, newest: int, source: str
) -> _Document:
    """Read what `sealed_json` wrote.

    Raises
    ------
    DamagedFileError
        If the bytes are not what was written.
    FormatError, VersionError
        If it is another kind of document, or from a newer version.
    """
    try:
        raw = parse_json(data.decode("utf-8"), source)
    except (UnicodeDecodeError, FormatError) as error:
        msg = f"{source} is damaged: {error}; restore it from a copy"
        raise DamagedFileError(msg) from error
    check_header(raw, format_name=format_name, newest=newest, source=source)
    seal = raw.pop("sha256", None)
    if seal != _seal(raw):
        msg = (
            f"{source} is damaged: its checksum does not fit its content; restore it from a copy "
            "(exposight does not read these files after editing by hand)"
        )
        raise DamagedFileError(msg)
    return validate(model, json.dumps(raw), source)


def _seal(content: dict[str, Any]) -> str:
    # One spelling of equal content, so that indentation and the order of keys do not matter.
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return sha256_of(text.encode())
