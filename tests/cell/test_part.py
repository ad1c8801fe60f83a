import math
from typing import get_args

import numpy as np
import pytest
from scipy import integrate

from exposight.cell import PAPER_TOLERANCE, RULES, Feature, FeatureKind, Part, RingTolerance
from exposight.errors import FeatureError
from exposight.geometry import RigidTransform, count_points_inside


def feature(name="f1", kind="hole", radius_mm=5.0, **sizes):
    return Feature(
        name=name, kind=kind, part_from_feature=RigidTransform(), radius_mm=radius_mm, **sizes
    )


@pytest.mark.parametrize("kind", ["hole", "sphere", "surface_point"])
@pytest.mark.parametrize("radius", [0.0, -2.0])
def test_a_radius_that_is_not_positive_names_the_feature(kind, radius):
    with pytest.raises(FeatureError, match=f"'f7': the radius of a {kind} must be above 0 mm, got"):
        feature("f7", kind, radius)


@pytest.mark.parametrize("radius", [math.nan, math.inf])
def test_a_radius_that_is_no_number_is_refused(radius):
    with pytest.raises(FeatureError, match="'f1': its radius_mm must be a number, got"):
        feature(radius_mm=radius)


@pytest.mark.parametrize(
    ("kind", "sizes", "message"),
    [
        ("bolt", {}, "its kind must be one of hole, slot, pocket, .*got 'bolt'"),
        ("slot", {}, "a slot needs a length_mm above 0 mm, got None"),
        ("slot", {"length_mm": 20.0, "width_mm": math.nan}, "needs a width_mm above 0 mm, got nan"),
        ("slot", {"length_mm": 8.0, "width_mm": 10.0}, "length_mm must be at least its width_mm"),
        ("slot", {"length_mm": 20.0, "width_mm": 8.0}, "half its width_mm, 4, got 5"),
        ("pocket", {"length_mm": 20.0, "width_mm": 8.0}, "at most 4 for 20 × 8 mm, got 5"),
        ("hole", {"length_mm": 20.0}, "a hole has no length_mm, got 20; leave it empty"),
    ],
)
def test_sizes_that_contradict_the_kind_are_refused(kind, sizes, message):
    with pytest.raises(FeatureError, match=f"feature 'f1': .*{message}"):
        feature(kind=kind, **sizes)


def test_a_feature_lies_within_a_kilometre():
    far = RigidTransform(translation_mm=np.array([0.0, -2e6, 0.0]))
    with pytest.raises(FeatureError, match="is its unit mm"):
        Feature(name="f1", kind="hole", part_from_feature=far, radius_mm=5.0)


def test_a_pocket_may_have_sharp_corners():
    assert feature(kind="pocket", radius_mm=0.0, length_mm=20.0, width_mm=8.0).radius_mm == 0


def test_a_pockets_corners_have_no_negative_radius():
    with pytest.raises(FeatureError, match="must be at least 0 mm, got -1"):
        feature(kind="pocket", radius_mm=-1.0, length_mm=20.0, width_mm=8.0)


@pytest.mark.parametrize("name", ["", " f1", "f1\u00a0"])
def test_a_feature_needs_a_clean_name(name):
    with pytest.raises(FeatureError, match="name without blanks at its ends, got"):
        feature(name)


def test_a_name_that_is_there_twice_is_named():
    features = (feature("a"), feature("b"), feature("a"))
    with pytest.raises(FeatureError, match="'a' is there twice, as number 1 and number 3"):
        Part(name="door", features=features)


def test_a_part_needs_a_feature():
    with pytest.raises(FeatureError, match="'door' has no feature"):
        Part(name="door", features=())


def test_a_feature_is_found_by_its_name():
    part = Part(name="door", features=(feature("a"), feature("b")))
    assert part.feature("b") is part.features[1]


def test_an_unknown_feature_tells_the_known_ones():
    part = Part(name="door", features=(feature("a"), feature("b")))
    with pytest.raises(FeatureError, match="no feature 'c'; its 2 features begin with a, b"):
        part.feature("c")


def test_a_part_needs_a_name():
    with pytest.raises(FeatureError, match="a part needs a name"):
        Part(name=" ", features=(feature(),))


# -- measured regions ----------------------------------------------------------------------------


def region(kind, tolerance=PAPER_TOLERANCE, **sizes):
    feature = Feature(name="f", kind=kind, part_from_feature=RigidTransform(), **sizes)
    return feature.measured_region(tolerance)


def area(cylinder, z=None):
    """Area of a region's cross-section, counted on a grid of 0.1 mm."""
    span = cylinder.bounding_radius_mm + 1
    axis = np.arange(-span, span, 0.1) + 0.05
    x, y = np.meshgrid(axis, axis)
    z = cylinder.plane_z_mm if z is None else z
    return count_inside(cylinder, np.stack([x, y, np.full_like(x, z)], axis=-1)) * 0.01


def count_inside(cylinder, points):
    points = np.asarray(points, dtype=np.float32)
    return int(count_points_inside([cylinder], points, [RigidTransform()])[0])


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
    assert [count_inside(ring, [point]) for point in points] == [0, 1, 1, 0, 0, 1]


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
    assert count_inside(disc, [[0.0, 0.0, 0.0]])
    assert area(disc) == pytest.approx(math.pi * 16, rel=GRID_RTOL)


def test_a_spheres_region_holds_its_cap_up_to_45_degrees():
    radius = 10.0
    polar = np.radians(np.linspace(0, 44.9, 50))
    cap = radius * np.column_stack([np.sin(polar), np.zeros(50), -np.cos(polar)])
    beyond = radius * np.array([math.sin(math.radians(46)), 0, -math.cos(math.radians(46))])
    sphere = region("sphere", radius_mm=radius)
    assert count_inside(sphere, cap) == len(cap)
    assert not count_inside(sphere, beyond[None])


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
