import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.report.door.labels import Ring, label_places


def ring(name, x_mm, y_mm, radius_mm=20.0):
    return Ring(name=name, x_mm=x_mm, y_mm=y_mm, radius_mm=radius_mm)


def test_a_ring_alone_has_its_name_above():
    (label,) = label_places([ring("f1", 5.0, 7.0)])
    assert label.position == "top center"
    assert label.x_mm == 5.0
    assert label.y_mm < 7.0 - 20.0


def test_a_ring_above_pushes_the_name_below():
    labels = label_places([ring("f1", 0.0, 0.0), ring("f2", 0.0, -45.0)])
    assert [label.position for label in labels] == ["bottom center", "top center"]


def test_two_names_do_not_take_the_same_place():
    one, other = label_places([ring("a_long_name", 0.0, 0.0), ring("a_long_name", 45.0, 0.0)])
    assert one.position != other.position


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(-400, 400), st.floats(-300, 300)), max_size=8))
def test_every_name_stands_beside_its_own_ring(places):
    rings = [ring(f"f{index}", *place) for index, place in enumerate(places)]
    labels = label_places(rings)
    away = [
        np.hypot(label.x_mm - own.x_mm, label.y_mm - own.y_mm)
        for label, own in zip(labels, rings, strict=True)
    ]
    np.testing.assert_allclose(away, 24.0)  # the ring's radius and a small gap
