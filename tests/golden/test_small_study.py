"""The simulated cell, decoding, learning and statistics give the numbers that are on record."""

import json
import math

import pytest
from small_study import GOLDEN, small_study

pytestmark = pytest.mark.slow

EXACT = 1e-9
FITTED = 1e-5
"""An optimiser's path feels the last bit of the machine's linear algebra."""


def _differences(record: object, now: object, tolerance: float, path: str) -> list[str]:
    if isinstance(record, list) and isinstance(now, list) and len(record) == len(now):
        pairs = [(f"{path}[{i}]", a, b) for i, (a, b) in enumerate(zip(record, now, strict=True))]
        return [line for where, a, b in pairs for line in _differences(a, b, tolerance, where)]
    if isinstance(record, float) and isinstance(now, float):
        same = math.isclose(record, now, rel_tol=tolerance, abs_tol=tolerance)
    else:
        same = record == now
    return [] if same else [f"{path}: {record} on record, {now} now"]


def test_the_numbers_on_record_come_out() -> None:
    record, now = json.loads(GOLDEN.read_text(encoding="utf-8")), small_study()
    assert record.keys() == now.keys()
    wrong = []
    for group, numbers in record.items():
        tolerance = FITTED if group.startswith("model ") else EXACT
        assert numbers.keys() == now[group].keys()
        for name, value in numbers.items():
            wrong += _differences(value, now[group][name], tolerance, f"{group}, {name}")
    assert not wrong, "\n".join(wrong[:20])
