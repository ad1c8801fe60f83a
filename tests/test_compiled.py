"""What is compiled again, and what is read from disk, after a source file has changed."""

import importlib
import sys

import pytest

CALLED = '''
from exposight.compiled import njit

FACTOR = 2.0

@njit(inline="always")
def scaled(x):
    """Scale."""
    return FACTOR * x
'''

CALLING = '''
from exposight.compiled import njit
from loops.called import scaled

@njit(error_model="numpy")
def shifted(x):
    """Scale and shift."""
    return scaled(x) + 1.0

@njit()
def factorial(n):
    return 1 if n < 2 else n * factorial(n - 1)
'''


@pytest.fixture
def call(tmp_path, monkeypatch):
    """Write both modules, import them afresh, call a function; return its value and cache hits."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    package = tmp_path / "loops"
    package.mkdir()
    (package / "__init__.py").touch()

    def run(called=CALLED, calling=CALLING, name="shifted"):
        (package / "called.py").write_text(called, encoding="utf-8")
        (package / "calling.py").write_text(calling, encoding="utf-8")
        for module in [module for module in sys.modules if module.split(".")[0] == "loops"]:
            monkeypatch.delitem(sys.modules, module)
        importlib.invalidate_caches()
        function = getattr(importlib.import_module("loops.calling"), name)
        value = function(3.0)
        return value, sum(function.stats.cache_hits.values())

    return run


def test_a_second_process_reads_what_the_first_compiled(call):
    assert call() == (7.0, 0)
    assert call() == (7.0, 1)


@pytest.mark.parametrize(
    ("called", "calling"),
    [
        (CALLED.replace("Scale.", "Multiply."), CALLING),
        (CALLED, '"""Module."""\n\n' + CALLING.replace("Scale and shift.", "Multiply and add.")),
        (CALLED, "# comment\n" + CALLING),
    ],
)
def test_docstrings_comments_and_line_numbers_compile_nothing_again(call, called, calling):
    call()
    assert call(called, calling) == (7.0, 1)


@pytest.mark.parametrize(
    ("called", "calling", "value"),
    [
        (CALLED.replace("FACTOR * x", "FACTOR * x + 1.0"), CALLING, 8.0),
        (CALLED.replace("FACTOR = 2.0", "FACTOR = 3.0"), CALLING, 10.0),
        (CALLED, CALLING.replace("+ 1.0", "+ 2.0"), 8.0),
        (CALLED, CALLING.replace('error_model="numpy"', "fastmath=True"), 7.0),
    ],
)
def test_changed_code_constants_and_options_compile_every_caller_again(
    call, called, calling, value
):
    call()
    assert call(called, calling) == (value, 0)


def test_a_function_that_calls_itself_is_kept_too(call):
    assert call(name="factorial") == (6.0, 0)
    assert call(name="factorial") == (6.0, 1)
