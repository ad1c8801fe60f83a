import dataclasses

import cv2
import numpy as np
import pytest
from benchmarks.agreement import compare_along_rays

from exposight.cell import Cloud
from exposight.errors import CloudError, ImageError
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.imaging import (
    AxisCoding,
    DecodedMap,
    FrameStack,
    Fringe,
    PatternSequence,
    decode,
    triangulate,
)

FLOAT32_MM = 1e-4  # a float32 at 500 mm resolves 3e-5 mm


def map_of(column=None, row=None, projector=(256, 192)):
    shape = (row if column is None else column).shape
    return DecodedMap(
        column=None if column is None else column.copy(),
        row=None if row is None else row.copy(),
        modulation=np.full(shape, 100.0, np.float32), flags=np.zeros(shape, np.uint8),
        projector_width=projector[0], projector_height=projector[1],
        exposure_ms=None, emulated=False,
    )  # fmt: skip


def cloud_of(scene, decoded, **limits):
    return triangulate(
        decoded, camera=scene.camera, projector=scene.projector,
        projector_from_camera=scene.projector_from_camera, **limits,
    )  # fmt: skip


@pytest.mark.parametrize("coded", ["columns", "rows", "both"])
def test_plane_is_recovered_through_two_distorting_lenses(scene, coded):
    if coded == "rows":  # the baseline is along x: rows alone need a rig turned by 90°
        scene = turned(scene)
    decoded = map_of(
        scene.column if coded != "rows" else None, scene.row if coded != "columns" else None
    )
    assert np.abs(cloud_of(scene, decoded).points - scene.points).max() < FLOAT32_MM


def turned(scene):
    projector_from_camera = RigidTransform.from_fanuc_wpr([10.0, -110.0, 20.0], -12.0, 2.0, 1.0)
    image = scene.projector.project(projector_from_camera.apply(scene.points))
    return dataclasses.replace(
        scene, projector_from_camera=projector_from_camera, column=image[..., 0], row=image[..., 1]
    )


def test_distortion_of_the_projector_matters_here(scene):
    straight = dataclasses.replace(scene.projector, distortion=())
    cloud = cloud_of(dataclasses.replace(scene, projector=straight), map_of(scene.column))
    error = np.linalg.norm(cloud.points - scene.points, axis=-1)
    assert np.nanmax(error) > 5.0


def test_tilted_and_thin_prism_lens(scene):
    lens = (0.1, -0.05, 1e-3, -1e-3, 0.01, 0.02, 0.01, 0.0, 1e-3, -2e-3, 2e-3, 1e-3, 0.03, -0.04)
    projector = dataclasses.replace(scene.projector, distortion=lens)
    image = projector.project(scene.projector_from_camera.apply(scene.points))
    cloud = cloud_of(dataclasses.replace(scene, projector=projector), map_of(image[..., 0]))
    assert np.abs(cloud.points - scene.points).max() < FLOAT32_MM


def test_agrees_with_the_plane_of_a_column_without_distortion():
    camera = PinholeCamera(width=3, height=2, fx=100, fy=100, cx=1, cy=0.5)
    projector = PinholeCamera(width=4, height=4, fx=100, fy=100, cx=2, cy=2)
    # z = f·b/(u_p − u_c) for parallel axes, both relative to their principal points.
    decoded = map_of(np.full((2, 3), 3.0), projector=(4, 4))
    cloud = triangulate(
        decoded, camera=camera, projector=projector,
        projector_from_camera=RigidTransform(translation_mm=(50.0, 0.0, 0.0)),
    )  # fmt: skip
    assert cloud.points[0, :2, 2] == pytest.approx([100 * 50 / 2, 100 * 50 / 1])
    assert np.isnan(cloud.points[:, 2]).all()  # parallel to the plane: it meets it nowhere


def test_agrees_with_points_that_opencv_projects(scene):
    projector = dataclasses.replace(scene.projector, skew=0.0)  # OpenCV knows no skew
    motion = scene.projector_from_camera
    image, _ = cv2.projectPoints(
        scene.points.reshape(-1, 1, 3),
        cv2.Rodrigues(motion.rotation)[0],
        motion.translation_mm,
        projector.matrix,
        np.array(projector.distortion),
    )
    column = image[:, 0, 0].reshape(scene.column.shape)
    cloud = cloud_of(dataclasses.replace(scene, projector=projector), map_of(column))
    assert np.abs(cloud.points - scene.points).max() < FLOAT32_MM


def test_missing_pixels_stay_missing(scene):
    column = scene.column.copy()
    column[3, 4] = np.nan
    cloud = cloud_of(scene, map_of(column))
    assert not cloud.valid[3, 4]
    assert cloud.n_valid == column.size - 1


@pytest.mark.parametrize("missing", ["column", "row"])
def test_a_pixel_half_read_has_no_point(scene, missing):
    coordinates = {"column": scene.column.copy(), "row": scene.row.copy()}
    coordinates[missing][7, 8] = np.nan
    decoded = map_of(**coordinates)
    cloud = cloud_of(scene, decoded)
    assert not cloud.valid[7, 8]
    assert cloud.n_valid == cloud.valid.size - 1 == decoded.counts().decoded
    assert decoded.counts().half_read == 1


def test_an_axis_that_is_not_coded_is_not_half_read(scene):
    assert map_of(scene.column).counts().half_read == 0


def test_inconsistent_row_is_left_out(scene):
    row = scene.row.copy()
    row[5, 6] += 8.0
    cloud = cloud_of(scene, map_of(scene.column, row), max_residual_px=2.0)
    assert not cloud.valid[5, 6]
    assert cloud.n_valid == row.size - 1


def test_depth_limits(scene):
    z = scene.points[..., 2]
    cloud = cloud_of(scene, map_of(scene.column), depth_limits_mm=(480.0, 510.0))
    assert np.array_equal(cloud.valid, (z > 480.0) & (z < 510.0))


def test_a_point_behind_the_camera_is_missing():
    camera = PinholeCamera(width=3, height=1, fx=100, fy=100, cx=1, cy=0)
    cloud = triangulate(
        map_of(np.full((1, 3), 0.0), projector=(4, 4)), camera=camera,
        projector=PinholeCamera(width=4, height=4, fx=100, fy=100, cx=2, cy=2),
        projector_from_camera=RigidTransform(translation_mm=(50.0, 0.0, 0.0)),
    )  # fmt: skip
    assert cloud.n_valid == 0


def test_ray_through_the_projectors_centre_has_no_depth():
    camera = PinholeCamera(width=3, height=1, fx=100, fy=100, cx=1, cy=0)
    cloud = triangulate(
        map_of(np.full((1, 3), 2.0), projector=(4, 4)), camera=camera,
        projector=PinholeCamera(width=4, height=4, fx=100, fy=100, cx=2, cy=2),
        projector_from_camera=RigidTransform(),
    )  # fmt: skip
    assert cloud.n_valid == 0


def test_frames_of_another_camera(scene):
    with pytest.raises(ImageError, match="the frames have 60 × 96 px, the camera 120 × 96"):
        cloud_of(scene, map_of(scene.column[:, :60]))


def test_patterns_of_another_projector(scene):
    with pytest.raises(ImageError, match="the patterns are 64 × 192 px, the projector 256 × 192"):
        cloud_of(scene, map_of(scene.column, projector=(64, 192)))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"depth_limits_mm": (5.0, 5.0)}, "0 ≤ near < far in mm, got near 5 and far 5$"),
        ({"max_residual_px": 0.0}, "residual must be above 0 px, got 0$"),
    ],
)
def test_bad_limits(scene, limits, message):
    with pytest.raises(ImageError, match=message):
        cloud_of(scene, map_of(scene.column), **limits)


def test_from_frames_to_the_plane(scene, render_fringe):
    """Render three frequencies on the plane with 16 bits, decode, triangulate."""
    periods, shifts = (1, 8, 64), [0, 90, 180, 270]
    images = np.concatenate([render_fringe(scene.column, p, 256, shifts) for p in periods])
    sequence = PatternSequence(
        name="1:8:64", projector_width=256, projector_height=192, bit_depth=16,
        columns=AxisCoding(
            fringes=tuple(
                Fringe(periods=p, frames=tuple(range(4 * i, 4 * i + 4)))
                for i, p in enumerate(periods)
            )
        ),
    )  # fmt: skip
    stack = FrameStack(frames=np.rint(257 * images).astype(np.uint16), bit_depth=16)
    cloud = cloud_of(scene, decode(stack, sequence))
    on_projector = (scene.column > -0.5) & (scene.column < 255.5)
    assert np.array_equal(cloud.valid, on_projector)
    error = np.linalg.norm(cloud.points - scene.points, axis=-1)[on_projector]
    assert error.max() < 1e-3  # 16-bit grey levels: 1e-5 rad of a period of 4 px


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
