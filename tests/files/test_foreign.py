"""Parsers of foreign files: whatever they raise or do, the caller gets one kind of error."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from exposight.errors import DamagedFileError, FormatError
from exposight.files import foreign, parse_apart, parsing

PARSERS = {
    "doubles": "return {'twice': np.frombuffer(data, np.uint8) * int(times)}",
    "crashes": "import ctypes; ctypes.string_at(0)",
    "raises": "raise KeyError('no such block')",
    "hangs": "import time; time.sleep(60)",
    "eats": "return {'x': np.ones(int(3e9))}",
    "prints": "print('hello'); return {'x': np.ones(1)}",
}


@pytest.fixture
def apart(tmp_path: Path):
    def run(name: str, data: bytes = b"\x01\x02", **options):
        path = tmp_path / f"{name}.py"
        path.write_text(
            f"import numpy as np\ndef parse(data, times='2'):\n    {PARSERS[name]}\n",
        )
        return parse_apart(path, data, source="a.bin", what="test file", **options)

    return run


@pytest.mark.parametrize(
    "raised", [KeyError("x"), IndexError(), ZeroDivisionError(), MemoryError()]
)
def test_whatever_a_parser_raises_names_the_file(raised):
    with pytest.raises(FormatError, match=r"cloud\.ply"), parsing("cloud.ply", "PLY cloud"):
        raise raised


def test_deep_recursion_and_panics_are_format_errors():
    class Panic(BaseException):
        pass

    for raised in (RecursionError(), Panic("index out of bounds")):
        with pytest.raises(FormatError, match=r"cloud\.ply"), parsing("cloud.ply", "PLY cloud"):
            raise raised


@pytest.mark.parametrize("raised", [DamagedFileError("mine"), KeyboardInterrupt(), SystemExit()])
def test_own_errors_and_the_end_of_the_program_pass(raised):
    with pytest.raises(type(raised)) as caught, parsing("cloud.ply", "PLY cloud"):
        raise raised
    assert caught.value is raised


@pytest.mark.slow
def test_a_parser_apart_returns_arrays_and_takes_options(apart):
    np.testing.assert_array_equal(apart("doubles", times="3")["twice"], [3, 6])
    np.testing.assert_array_equal(apart("prints")["x"], [1.0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "fact"),
    [("crashes", "crashed"), ("raises", "no such block"), ("hangs", "more than 2 s")],
)
def test_what_a_parser_apart_does_is_an_error(apart, name, fact):
    with pytest.raises(FormatError, match=fact):
        apart(name, seconds=2.0)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux")
def test_a_parser_apart_has_only_the_memory_it_is_given(apart):
    with pytest.raises(FormatError, match="memory"):
        apart("eats", memory_gb=1.0)


@pytest.mark.parametrize("platform", ["win32", "darwin"])
def test_where_memory_cannot_be_limited_a_parser_still_answers(monkeypatch, platform):
    resource = pytest.importorskip("resource")
    asked = []

    def refuse(kind, _limits):  # as macOS does, and as this process stays as it is
        asked.append(kind)
        if kind == resource.RLIMIT_AS:
            raise ValueError

    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(resource, "setrlimit", refuse)
    foreign._limit_this_process(1.0, 10)
    assert (resource.RLIMIT_CPU in asked) == (platform == "darwin")
