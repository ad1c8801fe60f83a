import numpy as np

from exposight.contradictions.rings import points_elsewhere, too_many_points

NAMES = [f"h{i}" for i in range(4)]
PIXELS = np.full(4, 500.0)


def test_rings_as_they_are():
    assert too_many_points(np.array([1.0, 0.2, np.nan, 1.05]), PIXELS, NAMES) is None


def test_one_ring_with_too_many_points_may_be_its_normal():
    found = too_many_points(np.array([1.0, 1.3, 0.9, 0.8]), PIXELS, NAMES)
    assert not found.is_error
    assert "1.30 in 1 of 4 rings (h1)" in found.found
    assert "normal" in found.explanation


def test_all_rings_with_too_many_points():
    found = too_many_points(np.array([1.30, 1.34, np.nan, 1.31]), PIXELS, NAMES)
    assert found.is_error
    assert "3 of 3 rings" in found.found


def test_small_rings_are_cut_by_their_border():
    assert too_many_points(np.array([1.2] * 4), np.full(4, 30.0), NAMES) is None


def test_points_where_features_are():
    assert points_elsewhere(np.ones(4), np.ones(4), np.zeros(4)) is None
    one_covered = points_elsewhere(np.ones(4), np.array([1, 1, 0, 1.0]), np.array([0, 0, 40, 0.0]))
    assert one_covered is None  # a clamp before a hole is no contradiction


def test_no_points_seen_are_no_points_elsewhere():
    assert points_elsewhere(np.zeros(4), np.zeros(4), np.full(4, np.nan)) is None


def test_points_before_all_features():
    found = points_elsewhere(np.ones(4), np.zeros(4), np.array([40.0, 42, 41, 43]))
    assert found.is_error
    assert "4 of 4 rings" in found.found
    assert "41.5 mm nearer" in found.found


def test_matched_points_are_smeared():
    once = np.array([1.0, 1.18, 0.9, 0.8])
    assert too_many_points(once, PIXELS, NAMES) is not None
    assert too_many_points(once, PIXELS, NAMES, matched=True) is None
    assert too_many_points(np.full(4, 1.18), PIXELS, NAMES, matched=True).is_error
