"""Mutated files: each is refused by an error of ours, or read as something that may be."""

from __future__ import annotations

import sys

import pytest
from tests.fuzz.formats import all_formats
from tests.fuzz.mutants import find, share_of, shown

MUTANTS = 300

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="memory is measured on Linux"),
]


@pytest.mark.parametrize("name", all_formats())
def test_mutants_are_refused_or_right(name):
    format_ = all_formats()[name]
    findings = find(format_, range(share_of(format_, MUTANTS)))
    assert findings.mutants >= 10
    assert not findings.faults, shown(findings)
    assert findings.peak_gb < 2.0
