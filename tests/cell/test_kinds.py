import math
from typing import get_args

import numpy as np
import pytest
from scipy import integrate

from exposight.cell import PAPER_TOLERANCE, RULES, Feature, FeatureKind, RingTolerance
from exposight.errors import FeatureError
from exposight.geometry import RigidTransform


def region(kind, tolerance=PAPER_TOLERANCE, **sizes):
    feature = Feature(name="f", kind=kind, part_from_feature=RigidTransform(), **sizes)
    return feature.measured_region(tolerance)


def area(cylinder, z=None):
    """Area of a region's cross-section, counted on a grid of 0.1 mm."""
    span = cylinder.bounding_radius_mm + 1
    axis = np.arange(-span, span, 0.1) + 0.05
    x, y = np.meshgrid(axis, axis)
    z = cylinder.plane_z_mm if z is None else z
    return cylinder.contains(np.stack([x, y, np.full_like(x, z)], axis=-1)).sum() * 0.01


GRID_RTOL = 5e-3
"""A grid of 0.1 mm counts a border of some 100 mm to within a few tenths of a square mm."""


def test_every_kind_has_a_rule():
    assert set(RULES) == set(get_args(FeatureKind))


def test_a_holes_ring_is_the_papers():
    ring = region("hole", radius_mm=6.0)
    assert (ring.inner_mm, ring.outer_mm, ring.height_mm) == (9.0, 11.0, 20.0)


def test_other_tolerances_are_taken():
    ring = region("hole", RingTolerance(height_mm=4.0, inner_mm=1.0, outer_mm=1.5), radius_mm=6.0)
    assert (ring.inner_mm, ring.outer_mm, ring.height_mm) == (7.0, 7.5, 4.0)


def test_a_slots_ring_is_a_stadium():
    straight, width = 14.0, 6.0
    ring = region("slot", radius_mm=3.0, length_mm=straight + width, width_mm=width)
    expected = math.pi * (8**2 - 6**2) + 2 * straight * 2
    assert area(ring) == pytest.approx(expected, rel=GRID_RTOL)


def test_a_slots_ring_keeps_its_distance_along_and_across():
    ring = region("slot", radius_mm=3.0, length_mm=20.0, width_mm=6.0)
    points = [[12.9, 0, 0], [13.1, 0, 0], [14.9, 0, 0], [15.1, 0, 0], [0, 5.9, 0], [0, 6.1, 0]]
    assert ring.contains(points).tolist() == [False, True, True, False, False, True]


def test_a_round_slot_is_a_hole():
    assert region("slot", radius_mm=4.0, length_mm=8.0, width_mm=8.0) == region(
        "hole", radius_mm=4.0
    )


@pytest.mark.parametrize("corner", [0.0, 2.0])
def test_a_pockets_frame_is_rounded(corner):
    length, width = 30.0, 16.0
    ring = region("pocket", radius_mm=corner, length_mm=length, width_mm=width)
    core = 2 * (length - 2 * corner) + 2 * (width - 2 * corner)
    inner, outer = corner + 3, corner + 5
    expected = core * 2 + math.pi * (outer**2 - inner**2)
    assert area(ring) == pytest.approx(expected, rel=GRID_RTOL)


def test_a_surface_point_is_measured_by_its_disc():
    disc = region("surface_point", radius_mm=4.0)
    assert disc.contains([0.0, 0.0, 0.0])
    assert area(disc) == pytest.approx(math.pi * 16, rel=GRID_RTOL)


def test_a_spheres_region_holds_its_cap_up_to_45_degrees():
    radius = 10.0
    polar = np.radians(np.linspace(0, 44.9, 50))
    cap = radius * np.column_stack([np.sin(polar), np.zeros(50), -np.cos(polar)])
    beyond = radius * np.array([math.sin(math.radians(46)), 0, -math.cos(math.radians(46))])
    sphere = region("sphere", radius_mm=radius)
    assert sphere.contains(cap).all()
    assert not sphere.contains(beyond)


def test_a_spheres_plane_is_at_its_caps_mean_height():
    def ring_area(polar):
        return math.sin(polar)

    total, _ = integrate.quad(ring_area, 0, math.pi / 4)
    moment, _ = integrate.quad(lambda p: -10 * math.cos(p) * ring_area(p), 0, math.pi / 4)
    assert region("sphere", radius_mm=10.0).plane_z_mm == pytest.approx(moment / total)


@pytest.mark.parametrize(
    "sizes",
    [
        {"height_mm": 0.0},
        {"inner_mm": 5.0},
        {"inner_mm": -1.0},
        {"outer_mm": math.inf},
        {"height_mm": math.nan},
    ],
)
def test_an_impossible_tolerance_is_refused(sizes):
    with pytest.raises(FeatureError, match="height above 0 and 0 ≤ inner < outer in mm, got"):
        RingTolerance(**sizes)
