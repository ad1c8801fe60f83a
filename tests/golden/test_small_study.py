"""The simulated cell, decoding, learning and statistics give the numbers that are on record."""

import json
import math

import pytest
from small_study import GOLDEN, small_study

pytestmark = pytest.mark.slow

EXACT = 1e-9
FITTED = 1e-5
"""An optimiser's path feels the last bit of the machine's linear algebra."""
COUNTED = {
    **dict.fromkeys(("n_points", "p_norm"), 0.03),
    **dict.fromkeys(("points", "std_x_mm", "std_y_mm", "std_z_mm"), 5e-4),
    **dict.fromkeys(("mean_x_mm", "mean_y_mm", "mean_z_mm"), 0.01),
    "frames_sum": 1e-8,
}
"""Rays of another instruction set move a grey value's last bit before it is rounded, and so a pixel
in 10⁹, with those that are decoded beside it."""


def _differences(record: object, now: object, tolerance: float, path: str) -> list[str]:
    if isinstance(record, list) and isinstance(now, list) and len(record) == len(now):
        pairs = [(f"{path}[{i}]", a, b) for i, (a, b) in enumerate(zip(record, now, strict=True))]
        return [line for where, a, b in pairs for line in _differences(a, b, tolerance, where)]
    if isinstance(record, float | int) and isinstance(now, float | int):
        same = math.isclose(record, now, rel_tol=tolerance, abs_tol=tolerance)
    else:
        same = record == now
    return [] if same else [f"{path}: {record} on record, {now} now"]


def test_the_numbers_on_record_come_out() -> None:
    record = json.loads(GOLDEN.read_text(encoding="utf-8"))
    now = small_study(record)
    assert record.keys() == now.keys()
    wrong = []
    for group, numbers in record.items():
        tolerance = FITTED if group.startswith("model ") else EXACT
        assert numbers.keys() == now[group].keys()
        for name, value in numbers.items():
            within = COUNTED.get(name, tolerance)
            wrong += _differences(value, now[group][name], within, f"{group}, {name}")
    assert not wrong, "\n".join(wrong[:20])
