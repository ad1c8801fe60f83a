import math

import pytest

from exposight.cell import Feature, Part
from exposight.errors import FeatureError
from exposight.geometry import RigidTransform


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


def test_a_pocket_may_have_sharp_corners():
    assert feature(kind="pocket", radius_mm=0.0, length_mm=20.0, width_mm=8.0).radius_mm == 0


def test_a_pockets_corners_have_no_negative_radius():
    with pytest.raises(FeatureError, match="must be at least 0 mm, got -1"):
        feature(kind="pocket", radius_mm=-1.0, length_mm=20.0, width_mm=8.0)


@pytest.mark.parametrize("name", ["", " f1", "f1\n"])
def test_a_feature_needs_a_clean_name(name):
    with pytest.raises(FeatureError, match="printable name without blanks at its ends, got"):
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
