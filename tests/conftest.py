"""Where the recordings and the reference values are; both may be absent."""

import io
import json
import os
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import exposight.twin  # noqa: F401 - before plans: they import each other for now

_REPOSITORY = Path(__file__).resolve().parent.parent


def _folder(variable: str, default: Path, what: str) -> Path:
    folder = Path(os.environ.get(variable, default))
    if not folder.is_dir():
        pytest.skip(f"{what} not found: set {variable} to their folder")
    return folder


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of recorded stripe images; the test is skipped where it is absent."""
    default = _REPOSITORY.parent / "shared" / "data" / "real"
    return _folder("EXPOSIGHT_REAL_DATA", default, "the real recordings were")


@pytest.fixture(scope="session")
def reference_data() -> Path:
    """Folder of values computed by other software; the test is skipped where it is absent."""
    default = _REPOSITORY.parent / "shared" / "data" / "reference"
    return _folder("EXPOSIGHT_REFERENCE_DATA", default, "the reference values were")


@dataclass(frozen=True)
class Ended:
    """How a command ended and what it printed."""

    exit_code: int
    stdout: str
    stderr: str


@pytest.fixture(scope="session")
def run() -> Callable[..., Ended]:
    """Run the command line in this process, on a terminal of 80 columns."""
    from exposight.cli import main

    def invoke(*arguments: object) -> Ended:
        stdout, stderr = io.StringIO(), io.StringIO()
        with redirect_stdout(stdout), redirect_stderr(stderr):
            try:
                status = main([str(argument) for argument in arguments])
            except SystemExit as end:
                status = int(end.code or 0)
        return Ended(status, stdout.getvalue(), stderr.getvalue())

    return invoke


@pytest.fixture(scope="session")
def run_json(run: Callable[..., Ended]) -> Callable[..., dict[str, Any]]:
    """Run with --json and return the object, which must be all of standard output."""

    def invoke(*arguments: object) -> dict[str, Any]:
        ended = run(*arguments, "--json")
        assert ended.exit_code == 0, ended.stdout + ended.stderr
        return json.loads(ended.stdout)

    return invoke
