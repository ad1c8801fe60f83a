import numpy as np
import pytest

from exposight.cell import Cloud
from exposight.errors import CloudError
from exposight.imaging import compare_along_rays


def test_points_of_the_surface_between_pixels_agree(scene):
    between = 0.5 * (scene.points[:-1, :-1] + scene.points[1:, 1:])
    agreement = compare_along_rays(Cloud(points=scene.points), between, scene.camera)
    assert agreement.common_points == between[..., 0].size
    assert agreement.median_mm < 0.01  # bilinear interpolation of a plane in perspective


def test_an_offset_along_the_rays_is_measured(scene):
    agreement = compare_along_rays(
        Cloud(points=scene.points), 1.01 * scene.points[1:-1, 1:-1], scene.camera
    )
    expected = 0.01 * np.linalg.norm(scene.points[1:-1, 1:-1], axis=-1)
    assert agreement.p90_mm == pytest.approx(np.percentile(expected, 90), abs=0.01)


def test_missing_points_are_not_common(scene):
    points = scene.points.copy()
    points[10] = np.nan
    reference = 0.5 * (scene.points[9:12, :-1] + scene.points[9:12, 1:])
    reference[2, 0] = np.nan
    agreement = compare_along_rays(Cloud(points=points), reference, scene.camera)
    assert agreement.common_points < 2 * reference.shape[1]


def test_nothing_in_common(scene):
    with pytest.raises(CloudError, match="no point in common"):
        compare_along_rays(Cloud(points=scene.points), -scene.points, scene.camera)


def test_unorganised_cloud(scene):
    with pytest.raises(CloudError, match="expected a cloud of 96 rows × 120 columns"):
        compare_along_rays(Cloud(points=scene.points.reshape(-1, 3)), scene.points, scene.camera)
