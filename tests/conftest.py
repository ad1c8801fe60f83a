"""Where the recordings and the reference values are; both may be absent."""

import os
from pathlib import Path

import pytest

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
