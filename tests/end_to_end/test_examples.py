"""Every example runs and prints what its first lines promise."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PROMISED = {
    "01_ten_lines.py": [
        "quality   all",
        "exposure  all",
        "4 of 4 features succeeded, 4 were promised",
    ],
    "02_decode_stripes.py": ["points, median error 0."],
    "03_own_driver.py": ["0.2 ms: i_avg 4, p_norm 0.00", "5.0 ms: i_avg 100, p_norm 1.00"],
    "04_own_predictor.py": ["unseen observations: RMSE", "50 mm: known", "900 mm: unknown"],
    "07_own_strategy.py": ["halving", "geometric_3  ", "exposures a view"],
    "06_own_kernel.py": ["│ e_k6    ┆ test ", "│ e_power ┆ test ", "no band reaches below"],
}
NEED_A_RECORDING = ["05_skull.py"]  # tests/real


def test_every_example_is_run():
    assert sorted([*PROMISED, *NEED_A_RECORDING]) == sorted(
        path.name for path in EXAMPLES.glob("[0-9]*.py")
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", PROMISED)
def test_example(name):
    run = subprocess.run(
        [sys.executable, EXAMPLES / name], capture_output=True, text=True, timeout=240, check=False
    )
    assert run.returncode == 0, run.stderr
    for words in PROMISED[name]:
        assert words in run.stdout


@pytest.mark.parametrize("name", PROMISED)
def test_example_is_short(name):
    assert len((EXAMPLES / name).read_text().splitlines()) <= 60
