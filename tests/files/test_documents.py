"""Records are written as they are, and faults in them are told in words of the file."""

import codecs
import json
import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import Discriminator, Field, Tag

from exposight.errors import DamagedFileError, FormatError, InputError, VersionError
from exposight.files import DocumentFormat, StoredAs, parse_json, validate


@dataclass(frozen=True)
class Steps:
    count: Annotated[int, Field(ge=2, le=9)]


def written_as(value):
    return "steps" if isinstance(value, dict) else "list"


@dataclass(frozen=True)
class Plane:
    depth_mm: Annotated[float, Field(gt=0, lt=1000)] = 1.0
    x_mm: Annotated[
        Annotated[tuple[float, ...], Tag("list"), Field(min_length=1, max_length=3)]
        | Annotated[Steps, Tag("steps")],
        Discriminator(written_as),
    ] = (0.0,)


@dataclass(frozen=True)
class Document:
    name: str = ""
    side: Literal["inside", "outside"] = "inside"
    closed: bool = True
    checksum: Annotated[str, Field(pattern="^[0-9a-f]{4}$")] = "0000"
    planes: tuple[Plane, ...] = ()

    def __post_init__(self):
        if self.name == "impossible":
            raise InputError("a document cannot be called so")


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ({"name": 7}, "key 'name': expected a text, got 7"),
        ({"name": None}, "key 'name': expected a text, got null"),
        ({"side": "left"}, "key 'side': expected 'inside' or 'outside', got \"left\""),
        ({"closed": 1}, "key 'closed': expected true or false, got 1"),
        ({"checksum": "xyz"}, "key 'checksum': expected a text of the form ^[0-9a-f]{4}$"),
        ({"planes": 3}, "key 'planes': expected a list, got 3"),
        ({"planes": [7]}, "key 'planes[0]': expected keys with values, got 7"),
        ({"planes": [{}, {"x": 1}]}, "key 'planes[1].x' is unknown"),
        ({"planes": [{"depth_mm": 0}]}, "'planes[0].depth_mm': expected a number above 0, got 0"),
        ({"planes": [{"depth_mm": 1e3}]}, "expected a number below 1000, got 1000.0"),
        ({"planes": [{"depth_mm": float("nan")}]}, "expected a finite number, got NaN"),
        (
            {"planes": [{"depth_mm": "5"}]},
            'expected a number, got the text "5"; leave out the quotation marks',
        ),
        ({"planes": [{"depth_mm": "deep"}]}, 'expected a number, got "deep"'),
        ({"planes": [{"x_mm": [1, 2, "c"]}]}, "'planes[0].x_mm[2]': expected a number, got \"c\""),
        ({"planes": [{"x_mm": []}]}, "'planes[0].x_mm': expected 1 or more entries, got 0"),
        ({"planes": [{"x_mm": [1] * 4}]}, "'planes[0].x_mm': expected up to 3 entries, got 4"),
        ({"planes": [{"x_mm": {}}]}, "key 'planes[0].x_mm.count' is missing"),
        ({"planes": [{"x_mm": {"count": 1}}]}, ".x_mm.count': expected a number from 2 up, got 1"),
        ({"planes": [{"x_mm": {"count": 10}}]}, "expected a number up to 9, got 10"),
        ({"planes": [{"x_mm": {"count": 2.5}}]}, "expected a whole number, got 2.5"),
        ({"name": ["long"] * 99}, 'expected a text, got ["long", "long"'),
        ({"colour": 1, "side": 2}, "'inside' or 'outside', got 2; key 'colour' is unknown"),
    ],
)
def test_a_fault_names_key_expectation_and_value(written, message):
    with pytest.raises(FormatError) as caught:
        validate(Document, written, "plan.toml")
    told = str(caught.value)
    assert told.startswith("plan.toml: key '")
    assert message in told
    assert "Input" not in told
    assert len(told) < 200


def test_what_a_record_refuses_itself_is_told_with_its_source():
    with pytest.raises(FormatError, match=r"^plan\.toml: a document cannot be called so$"):
        validate(Document, {"name": "impossible"}, "plan.toml")


def test_what_is_nested_too_deeply_is_refused():
    nested = []
    for _ in range(500):
        nested = [nested]
    with pytest.raises(FormatError, match=r"^plan\.toml: it cannot be read"):
        validate(Document, {"name": nested}, "plan.toml")


# -- whole documents ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Place:
    name: str
    at: Annotated[
        complex,
        StoredAs(
            tuple[float, float], write=lambda z: [z.real, z.imag], read=lambda pair: complex(*pair)
        ),
    ]
    count: int = 1


FORMAT = DocumentFormat("exposight place", 2, Place)
PLACE = Place("Höhe", 1.5 - 2j, 3)


def test_a_record_is_written_under_its_format_and_read_back():
    text = FORMAT.to_json(PLACE)
    assert list(json.loads(text)) == ["format", "version", "name", "at", "count"]
    assert json.loads(text)["at"] == [1.5, -2]
    assert FORMAT.from_json(text, "f") == PLACE
    assert FORMAT.unseal(FORMAT.seal(PLACE), "f") == PLACE


def test_numbers_of_numpy_are_written_as_json_s():
    text = FORMAT.to_json(Place("a", 0j, np.int64(7)))
    assert FORMAT.from_json(text, "f").count == 7


def test_an_older_version_may_lack_what_has_a_default():
    older = {"format": "exposight place", "version": 1, "name": "a", "at": [0, 0]}
    assert FORMAT.from_dict(older, "f").count == 1
    with pytest.raises(FormatError, match=r"key 'at\[1\]' is missing"):
        FORMAT.from_dict({**older, "at": [0]}, "f")
    with pytest.raises(FormatError, match='must be "exposight place", got "gpx"'):
        FORMAT.from_dict({**older, "format": "gpx"}, "f")
    with pytest.raises(VersionError, match="has version 3"):
        FORMAT.from_dict({**older, "version": 3, "more": 1}, "f")


def test_a_changed_byte_in_a_sealed_document_is_noticed():
    sealed = FORMAT.seal(PLACE)
    with pytest.raises(DamagedFileError, match="f is damaged"):
        FORMAT.unseal(sealed.replace(b"1.5", b"1.6"), "f")
    with pytest.raises(DamagedFileError, match="f is damaged"):
        FORMAT.unseal(sealed[:-3], "f")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1, "a": 2}', "key 'a' is there twice"),
        ('{"b": [{"a": 1, "a": 1}]}', "key 'a' is there twice"),
        ('{"a": NaN}', "key 'a': expected a finite number, got nan"),
        ('{"a": -Infinity}', "key 'a': expected a finite number, got -inf"),
        ('{"a": 1e999}', "key 'a': expected a finite number, got inf"),
        ('{"a": [[1, NaN]]}', "it holds nan"),
        ('{"a": ' + "9" * 400 + "}", "400 digits"),
        ('{"a": ' + "9" * 5000 + "}", "5000 digits"),
        ('{"a": ' * 150 + "1" + "}" * 150, "nested too deeply"),
        ('{"a": ' + "[" * 100_000, "nested too deeply"),
        (r'{"a": "\ud800"}', "not a readable JSON document"),
        ("[1]", "JSON object, got list"),
    ],
)
def test_json_that_says_two_things_or_none_is_refused(text, message):
    with pytest.raises(FormatError, match=re.escape(message)):
        parse_json(text, "file.json")


def test_a_byte_order_mark_is_no_matter():
    assert parse_json('\ufeff{"a": 1}', "file.json") == {"a": 1}
    sealed = codecs.BOM_UTF8 + FORMAT.seal(PLACE)
    assert FORMAT.unseal(sealed, "file.json") == PLACE


def test_whatever_a_record_raises_names_the_file():
    @dataclass(frozen=True)
    class Odd:
        count: int

        def __post_init__(self):
            _ = float(self.count) / 0.0

    for count in (1, 10**350):
        with pytest.raises(FormatError, match=r"^odd\.json"):
            validate(Odd, {"count": count}, "odd.json")


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_numbers_that_are_none_are_refused_where_any_value_goes(number):
    @dataclass(frozen=True)
    class Settings:
        simulated: dict[str, Any]

    with pytest.raises(FormatError, match="expected finite numbers"):
        validate(Settings, {"simulated": {"lamp": [number]}}, "plan")
    assert validate(Settings, {"simulated": {"lamp": "NaN"}}, "plan").simulated == {"lamp": "NaN"}
