import numpy as np
import pytest

from exposight.cell import Cloud
from exposight.errors import CloudError


def test_a_zero_point_is_missing():
    cloud = Cloud(points=np.array([[0, 0, 0], [1, 2, 3]]))
    assert cloud.valid.tolist() == [False, True]
    assert np.isnan(cloud.points[0]).all()


def test_a_zero_coordinate_is_not_missing():
    assert Cloud(points=np.array([[0.0, 0.0, 5.0]])).n_valid == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_coordinate_that_is_not_finite_makes_the_point_missing(bad):
    cloud = Cloud(points=np.array([[1.0, bad, 3.0], [1.0, 2.0, 3.0]]))
    assert np.isnan(cloud.points[0]).all()
    assert cloud.n_valid == 1


def test_an_organised_cloud_keeps_its_rows_and_columns():
    cloud = Cloud(points=np.ones((3, 4, 3)))
    assert cloud.organised
    assert cloud.valid.shape == (3, 4)
    assert cloud.points.dtype == np.float32


def test_a_cloud_neither_changes_nor_shares_the_array_it_was_given():
    points = np.zeros((5, 3), dtype=np.float32)
    cloud = Cloud(points=points)
    assert (points == 0).all()
    points[:] = 7
    assert cloud.n_valid == 0


def test_a_cloud_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        Cloud(points=np.ones((5, 3))).points[0, 0] = 2


@pytest.mark.parametrize("shape", [(3,), (4, 2), (2, 2, 4), (1, 2, 2, 3)])
def test_another_shape_is_refused(shape):
    with pytest.raises(CloudError, match=r"shape \(rows, columns, 3\) or \(n, 3\) in mm, got"):
        Cloud(points=np.ones(shape))


def test_text_is_refused():
    with pytest.raises(CloudError, match="real numbers in mm, got an array of <U1"):
        Cloud(points=np.array([["a", "b", "c"]]))


def test_require_points_returns_the_valid_points_in_row_major_order():
    points = np.arange(12.0).reshape(2, 2, 3)
    points[1, 0] = 0
    expected = points.reshape(-1, 3)[[0, 1, 3]]
    np.testing.assert_array_equal(Cloud(points=points).require_points(), expected)


def test_a_cloud_with_no_valid_point_is_refused_where_points_are_needed():
    cloud = Cloud(points=np.zeros((4, 5, 3)))
    with pytest.raises(CloudError, match="no valid point: all 20 are NaN or zero"):
        cloud.require_points()


def test_organise_gives_the_image_its_rows_and_columns_back():
    points = np.arange(1.0, 19.0).reshape(2, 3, 3)
    flat = Cloud(points=points.reshape(-1, 3))
    np.testing.assert_array_equal(flat.organise(2, 3).points, points)


def test_organise_refuses_another_number_of_points():
    with pytest.raises(CloudError, match=r"2 rows × 4 columns need 8 points.*got 6"):
        Cloud(points=np.ones((6, 3))).organise(2, 4)
