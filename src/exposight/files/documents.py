"""Documents: JSON and TOML files whose content is a frozen dataclass, validated strictly.

A stored record is described once, by its dataclass: the fields are the file's keys. Unknown and
missing keys, values of another type, infinite and undefined numbers are refused, and the message
names each key as the file has it: ``planes[0].x_mm.count``. What a field holds in memory but not on
disk, such as a pose, says how it is written by `StoredAs`.
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Generic, TypeVar, cast

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, core_schema

from exposight.errors import DamagedFileError, FormatError, InputError, VersionError
from exposight.files.durable import sha256_of
from exposight.files.foreign import parsing

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

Checksum = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
"""A SHA-256 in hexadecimal, as a record's field."""

_DEEPEST = 100
"""Objects and lists within each other, in any document."""

_DIGITS = 300
"""Of a whole number, which must remain one that can be computed with."""

_Record = TypeVar("_Record")


@dataclass(frozen=True)
class DocumentFormat(Generic[_Record]):
    """A kind of document: a JSON object with a format name, a version, and a record's fields.

    Parameters
    ----------
    name : str
        What its key ``format`` says.
    version : int
        The newest version, which is written; records read all older ones.
    record : type
        The frozen dataclass that holds the other keys. A field with a default may be missing.
    """

    name: str
    version: int
    record: type[_Record]

    def to_json(self, record: _Record) -> str:
        """Return a record as a JSON document."""
        return _pretty(self._content(record)) + "\n"

    def from_json(self, text: str, source: str) -> _Record:
        """Read a record from a JSON document.

        Parameters
        ----------
        text : str
            The document.
        source : str
            Where it comes from, for messages.

        Raises
        ------
        FormatError
            If it is not such a document, a key is missing or unknown, or a value is impossible.
        VersionError
            If a newer version of exposight wrote it.
        """
        return self.from_dict(parse_json(text, source), source)

    def from_bytes(self, data: bytes, source: str) -> _Record:
        """Read a record from the bytes of a JSON document in UTF-8; see `from_json`."""
        with parsing(source, "JSON document"):
            text = data.decode("utf-8-sig")
        return self.from_json(text, source)

    def from_dict(self, raw: Mapping[str, Any], source: str) -> _Record:
        """Read a record from a document that is parsed already; see `from_json`."""
        check_header(raw, format_name=self.name, newest=self.version, source=source)
        fields = {key: value for key, value in raw.items() if key not in {"format", "version"}}
        return validate(self.record, fields, source)

    def seal(self, record: _Record) -> bytes:
        """Return a record as a JSON document with a checksum of itself under ``sha256``."""
        content = self._content(record)
        return _pretty({**content, "sha256": _checksum(content)}).encode()

    def unseal(self, data: bytes, source: str) -> _Record:
        """Read what `seal` wrote.

        Raises
        ------
        DamagedFileError
            If the bytes are not what was written.
        FormatError, VersionError
            As `from_json`.
        """
        try:
            raw = parse_json(data.decode("utf-8-sig"), source)
        except (UnicodeDecodeError, FormatError) as error:
            msg = f"{source} is damaged: {error}; restore it from a copy"
            raise DamagedFileError(msg) from error
        check_header(raw, format_name=self.name, newest=self.version, source=source)
        if raw.pop("sha256", None) != _checksum(raw):
            msg = (
                f"{source} is damaged: its checksum does not fit its content; restore it from a "
                "copy (exposight does not read these files after editing by hand)"
            )
            raise DamagedFileError(msg)
        return self.from_dict(raw, source)

    def _content(self, record: _Record) -> dict[str, Any]:
        (fields,) = _adapter(self.record).dump_python((record,), warnings=False)
        return {"format": self.name, "version": self.version, **fields}


class StoredAs:
    """Says in an annotation how a field is written: ``Annotated[Pose, StoredAs(Rows, …)]``.

    Parameters
    ----------
    stored : type
        What the file holds; validated before it is read.
    write : callable
        Returns a value as it is stored.
    read : callable
        Returns the value of what is stored.
    """

    def __init__(
        self, stored: Any, *, write: Callable[[Any], Any], read: Callable[[Any], Any]
    ) -> None:
        self._stored, self._write, self._read = stored, write, read

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Return pydantic's schema: validate what is stored, then read it."""
        return core_schema.no_info_after_validator_function(
            self._read,
            handler.generate_schema(self._stored),
            serialization=core_schema.plain_serializer_function_ser_schema(self._write),
        )


def validate(record: type[_Record], raw: Mapping[str, Any], source: str) -> _Record:
    """Return parsed keys and values as a record.

    Parameters
    ----------
    record : type
        A dataclass; its fields are the keys.
    raw : mapping
        What the file's parser gave.
    source : str
        Where it comes from, for messages.

    Raises
    ------
    FormatError
        If a key is missing or unknown, a value has the wrong type, or values contradict each
        other; the message names each key as the file has it.
    """
    with parsing(source, "document"):  # whatever a record raises of values nobody thought of
        # As JSON, so that types are checked as strictly for TOML and YAML. JSON has no dates; no
        # key takes one, nor the object that stands for it here.
        text = json.dumps([raw], default=lambda other: {"date or time": str(other)})
        try:
            (value,) = _adapter(record).validate_json(text)
        except ValidationError as error:
            msg = f"{source}: {'; '.join(_fault(details, raw) for details in error.errors())}"
            raise FormatError(msg) from error
        except InputError as error:  # what the record itself refuses
            msg = f"{source}: {error}"
            raise FormatError(msg) from error
        if "NaN" in text or "Infinity" in text:  # where a record takes any value
            _check_values(json.loads(text), source)
    return cast("_Record", value)


_adapters: dict[Any, TypeAdapter[tuple[Any]]] = {}


def _adapter(record: Any) -> TypeAdapter[tuple[Any]]:
    """Return what validates and writes a record, made once."""
    if record not in _adapters:
        # In a tuple, because pydantic hands the configuration of a tuple down to the dataclasses in
        # it, and takes none for a dataclass alone.
        _adapters[record] = TypeAdapter(tuple[record], config=_STRICT)
    return _adapters[record]


def parse_json(text: str, source: str) -> dict[str, Any]:
    """Return the JSON object in a text.

    Raises
    ------
    FormatError
        If it is no JSON, or no object, has a key twice or a number that is none, or is nested more
        than a hundred deep; the message names the source.
    """
    try:
        raw = json.loads(
            text.removeprefix("\ufeff"),
            object_pairs_hook=_once,
            parse_int=_whole,
        )
    except json.JSONDecodeError as error:
        msg = f"{source} is not JSON (line {error.lineno}: {error.msg}); was it cut off?"
        raise FormatError(msg) from error
    except InputError as error:
        msg = f"{source}: {error}"
        raise FormatError(msg) from error
    except RecursionError as error:
        msg = f"{source} is not JSON: it is nested too deeply"
        raise FormatError(msg) from error
    if not isinstance(raw, dict):
        msg = f"{source} must hold a JSON object, got {type(raw).__name__}"
        raise FormatError(msg)
    _check_values(raw, source)
    if "\\u" in text:  # which can spell half a character
        with parsing(source, "JSON document"):
            _pretty(raw).encode()
    return raw


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object whose keys are there once: of two values nobody knows which is meant."""
    found = dict(pairs)
    if len(found) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        msg = f"key {next(key for key, n in counts.items() if n > 1)!r} is there twice"
        raise InputError(msg)
    for key, value in pairs:
        if isinstance(value, float) and not math.isfinite(value):
            msg = f"key {key!r}: expected a finite number, got {value}"
            raise InputError(msg)
    return found


def _whole(text: str) -> int:
    if len(text) > _DIGITS:
        msg = f"{text[:_LONGEST]}… has {len(text)} digits, and whole numbers up to {_DIGITS}"
        raise InputError(msg)
    return int(text)


def _check_values(raw: object, source: str) -> None:
    level: list[Any] = [raw]
    depth = 0
    while level:
        if depth > _DEEPEST:
            msg = f"{source} is nested too deeply: more than {_DEEPEST} levels"
            raise FormatError(msg)
        values = [each.values() if isinstance(each, dict) else each for each in level]
        inner = [each for of_one in values for each in of_one]
        if unbounded := [e for e in inner if isinstance(e, float) and not math.isfinite(e)]:
            msg = f"{source}: it holds {unbounded[0]}; expected finite numbers"
            raise FormatError(msg)
        level = [each for each in inner if isinstance(each, dict | list)]
        depth += 1


def check_header(raw: Mapping[str, Any], *, format_name: str, newest: int, source: str) -> None:
    """Check a document's format name and version, before anything else in it is looked at.

    Raises
    ------
    FormatError
        If it is another kind of document.
    VersionError
        If a newer version of exposight wrote it.
    """
    name = raw.get("format")
    if name != format_name:
        got = "and it is missing" if name is None else f"got {_written(name)}"
        msg = (
            f"{source}: key 'format' must be \"{format_name}\", {got}; is it another kind of file?"
        )
        raise FormatError(msg)
    version = raw.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        known = "1" if newest == 1 else f"a whole number from 1 to {newest}"
        got = "and it is missing" if version is None else f"got {_written(version)}"
        msg = f"{source}: key 'version' must be {known}, {got}"
        raise FormatError(msg)
    if version > newest:
        msg = (
            f"{source} has version {version} of the format {format_name!r}; this exposight reads "
            f"up to version {newest}: update exposight"
        )
        raise VersionError(msg)


def alike(one: object, other: object) -> bool:
    """Compare parsed documents: nested lists, dictionaries and values, numbers within 1e-9.

    Reading a pose makes its rotation exactly orthonormal, which changes its last digits.
    """
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(alike(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(alike, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)
    return one == other


def _checksum(content: Mapping[str, Any]) -> str:
    # One spelling of equal content, so that indentation and the order of keys do not matter.
    text = json.dumps(
        content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, default=_number
    )
    return sha256_of(text.encode())


def _pretty(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False, default=_number)


def _number(value: Any) -> Any:
    """Return a number of numpy as Python's, which is JSON's."""
    return value.item()


# -- faults -------------------------------------------------------------------------------------

_LONGEST = 60
"""Characters of a value that a message quotes."""

_EXPECTED: Mapping[str, str] = {
    "bool_type": "true or false",
    "dataclass_type": "keys with values",
    "dict_type": "keys with values",
    "finite_number": "a finite number",
    "float_parsing": "a number",
    "float_type": "a number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number from {ge:g} up",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "int_type": "a whole number",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number up to {le:g}",
    "list_type": "a list",
    "literal_error": "{expected}",
    "model_type": "keys with values",
    "string_pattern_mismatch": "a text of the form {pattern}",
    "string_type": "a text",
    "too_long": "up to {max_length} entries",
    "too_short": "{min_length} or more entries",
    "tuple_type": "a list",
}
"""What a value had to be, by the kind of pydantic's complaint, with the numbers it gives."""

_NUMBERS = {"float_parsing", "float_type", "int_parsing", "int_type"}


def _fault(details: ErrorDetails, raw: object) -> str:
    """Return one fault in words that fit any file format."""
    key = _path(details, raw)
    match details["type"]:
        case "missing":
            return f"key {key!r} is missing"
        case "extra_forbidden" | "unexpected_keyword_argument":
            return f"key {key!r} is unknown"
        case "json_invalid":
            return f"it cannot be read ({details['ctx']['error']})"
        case kind:
            expected = _EXPECTED.get(kind, kind).format(**details.get("ctx", {}))
            return f"key {key!r}: expected {expected}, got {_got(kind, details['input'])}"


def _path(details: ErrorDetails, raw: object) -> str:
    """Return a key as the file has it; where it may be one of several things, pydantic says which.

    Such a choice is no key of the file, so the path is followed through the data.
    """
    path = ""
    for step in details["loc"][1:]:  # the first one is the tuple's about the record
        if isinstance(step, int):
            path += f"[{step}]"
            raw = raw[step] if isinstance(raw, (list, tuple)) and step < len(raw) else None
        elif isinstance(raw, dict) and step in raw:
            path += f".{step}"
            raw = raw[step]
    if details["type"] == "missing" and isinstance(details["loc"][-1], str):
        path += f".{details['loc'][-1]}"
    return path.removeprefix(".")


def _got(kind: str, value: Any) -> str:
    if kind in {"too_short", "too_long"}:
        return str(len(value))
    text = _written(value)
    if kind in _NUMBERS and isinstance(value, str) and is_number(value):
        return f"the text {text}; leave out the quotation marks"
    return text


def _written(value: object) -> str:
    """Return a value nearly as a file has it, cut off where it is long."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def is_number(text: str) -> bool:
    """Return whether a text can be read as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
