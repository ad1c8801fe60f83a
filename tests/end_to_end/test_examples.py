"""Every example runs and prints what its first lines promise."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PROMISED = {
    "01_observe_a_hole.py": ["perfect: p_norm 1.000", "left half missing: p_norm 0."],
    "02_decode_stripes.py": ["points, median error 0."],
    "03_predict_quality.py": ["R² 9", "inside what it was", "outside what it was"],
    "04_kernels_and_gates.py": [
        "rational quadratic: ",
        "with change points at 10 and 255: 0.00 ± 0.00",
    ],
}


def test_every_example_is_run():
    assert sorted(PROMISED) == sorted(path.name for path in EXAMPLES.glob("[0-9]*.py"))


@pytest.mark.parametrize("name", PROMISED)
def test_example(name):
    run = subprocess.run(
        [sys.executable, EXAMPLES / name], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr
    for words in PROMISED[name]:
        assert words in run.stdout


@pytest.mark.parametrize("name", PROMISED)
def test_example_is_short(name):
    assert len((EXAMPLES / name).read_text().splitlines()) <= 60
