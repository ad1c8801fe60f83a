"""Alignment errors: their sizes, and that they depend on seed and view alone."""

import numpy as np
import pytest

from exposight.errors import InputError
from exposight.plans import view_seed
from exposight.twin import AlignmentErrors, draw_alignment

ERRORS = AlignmentErrors()
DRAWS = 2000
RMS_TOLERANCE = 0.04
"""Four standard errors of a root mean square over 2000 triples, 4/√(2·3·2000) = 3.7 %."""


def _draw(share: float, seed: int = 3):
    return [draw_alignment(ERRORS, share, seed, f"view-{i}") for i in range(DRAWS)]


@pytest.fixture(scope="module")
def photogrammetric():
    return _draw(0.0)


@pytest.fixture(scope="module")
def kinematic():
    return _draw(1.0)


def test_the_share_decides_who_aligns(photogrammetric, kinematic):
    assert {each.aligned_by for each in photogrammetric} == {"photogrammetry"}
    assert {each.aligned_by for each in kinematic} == {"kinematics"}


def test_a_quarter_means_a_quarter_of_many_views():
    by_kinematics = np.mean([each.aligned_by == "kinematics" for each in _draw(0.25)])
    assert by_kinematics == pytest.approx(0.25, abs=0.04)  # four standard deviations


@pytest.mark.parametrize("what", ["mm", "deg"])
def test_photogrammetric_errors_have_the_stated_root_mean_square(photogrammetric, what):
    sizes = np.array([getattr(each, f"error_{what}") for each in photogrammetric])
    expected = getattr(ERRORS, f"photogrammetric_{what}")
    assert np.sqrt(np.mean(sizes**2)) == pytest.approx(expected, rel=RMS_TOLERANCE)


@pytest.mark.parametrize("what", ["mm", "deg"])
def test_kinematic_errors_fill_the_range_up_to_the_greatest(kinematic, what):
    sizes = np.array([getattr(each, f"error_{what}") for each in kinematic])
    if what == "mm":  # beside the systematic shift
        shifts = np.array([each.reported_from_true.translation_mm for each in kinematic])
        sizes = np.linalg.norm(shifts - ERRORS.kinematic_mm, axis=1)
    greatest = getattr(ERRORS, f"kinematic_max_{what}")
    assert sizes.max() <= greatest
    assert np.quantile(sizes, [0.25, 0.5, 0.75]) == pytest.approx(
        greatest * np.array([0.25, 0.5, 0.75]), rel=0.12
    )


def test_kinematic_errors_have_one_direction_and_their_scatter_none(kinematic):
    shifts = np.array([each.reported_from_true.translation_mm for each in kinematic])
    assert shifts.mean(axis=0) == pytest.approx(ERRORS.kinematic_mm, abs=0.005)
    assert np.linalg.norm(ERRORS.kinematic_mm) == pytest.approx(4.5, abs=0.001)
    with pytest.raises(InputError, match="kinematic_mm must be three numbers"):
        AlignmentErrors(kinematic_mm=(1.0, 2.0))


def test_the_same_seed_and_view_give_the_same_error():
    first = draw_alignment(ERRORS, 0.5, 7, "near-x1-y1")
    assert draw_alignment(ERRORS, 0.5, 7, "near-x1-y1") == first


@pytest.mark.parametrize(("seed", "view"), [(8, "near-x1-y1"), (7, "near-x2-y1")])
def test_another_seed_or_view_gives_another_error(seed, view):
    first = draw_alignment(ERRORS, 0.0, 7, "near-x1-y1")
    assert draw_alignment(ERRORS, 0.0, seed, view) != first


def test_another_share_keeps_the_views_it_does_not_touch():
    lower, higher = _draw(0.2), _draw(0.3)
    still = [i for i in range(DRAWS) if higher[i].aligned_by == "photogrammetry"]
    assert all(lower[i] == higher[i] for i in still)


def test_no_error_is_the_identity():
    none = AlignmentErrors(photogrammetric_mm=0, photogrammetric_deg=0)
    drawn = draw_alignment(none, 0.0, 1, "a")
    assert (drawn.error_mm, drawn.error_deg) == (0.0, 0.0)


def test_a_views_seed_is_the_same_in_every_process():
    # Python's own hash of a text changes from run to run. This is the beginning of `sha256sum`'s.
    assert view_seed(5, "near-x1-y1") == (5, 6280484330295089661)


@pytest.mark.parametrize("bad", [-0.1, float("nan"), float("inf")])
def test_an_impossible_size_is_refused(bad):
    with pytest.raises(InputError, match="kinematic_max_mm must be a number from 0 up"):
        AlignmentErrors(kinematic_max_mm=bad)
