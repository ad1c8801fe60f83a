"""Stereo by codes: depth of a step, occlusion, and codes that say that the cameras do not fit."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.errors import ContradictionError, ImageError
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.imaging import DecodedMap, MatchOutcome, match_codes, rectify, stereo_by_codes

LIMITS = (300.0, 900.0)
IDEAL = PinholeCamera(width=200, height=150, fx=250.0, fy=250.0, cx=99.5, cy=74.5)
LENS = replace(IDEAL, fx=246.0, cy=76.0, distortion=(-0.12, 0.04, 5e-4, -4e-4))
ASIDE = RigidTransform(translation_mm=np.array([100.0, 0.0, 0.0]))
CONVERGING = RigidTransform.from_fanuc_wpr((98.0, 3.0, -5.0), 1.0, -10.0, 1.5)
PROJECTOR = RigidTransform.from_fanuc_wpr((150.0, 0.0, 0.0), 0.0, -16.0, 0.0)
"""In the first camera's frame."""
FAR_MM, NEAR_MM, EDGE_MM = 520.0, 485.0, 15.0
"""A wall at 520 mm, and from x = 15 mm on a step of 35 mm towards the cameras."""


def scene(camera, pose):
    """Points (rows, columns, 3) that a camera sees, in the first one's frame."""
    rays = np.concatenate([camera.rays(), np.ones((camera.height, camera.width, 1))], axis=-1)
    rays = rays @ pose.rotation.T
    start = pose.translation_mm
    near, far = (start + rays * ((z - start[2]) / rays[..., 2])[..., None] for z in
                 (np.full(rays.shape[:2], NEAR_MM), np.full(rays.shape[:2], FAR_MM)))  # fmt: skip
    return np.where(near[..., :1] > EDGE_MM, near, far)


def codes(camera, pose, *, axes="columns", noise=0.0, seed=1):
    """What a projector of 400 × 300 px, at the place PROJECTOR, shows there; shadow is dark."""
    points = scene(camera, pose)
    seen = PROJECTOR.inverse().apply(points.reshape(-1, 3)).reshape(points.shape)
    # The line to the projector must pass the edge of the step above it.
    rise = (NEAR_MM - points[..., 2]) / (PROJECTOR.translation_mm[2] - points[..., 2])
    passed = points[..., 0] + rise * (PROJECTOR.translation_mm[0] - points[..., 0])
    shadow = (points[..., 2] > NEAR_MM + 1.0) & (passed > EDGE_MM)
    column = 500.0 * seen[..., 0] / seen[..., 2] + 199.5
    row = 500.0 * seen[..., 1] / seen[..., 2] + 149.5
    dark = shadow | (column < -0.5) | (column > 399.5) | (row < -0.5) | (row > 299.5)
    rng = np.random.default_rng(seed)
    column, row = (
        np.where(dark, np.nan, each + noise * rng.standard_normal(each.shape))
        for each in (column, row)
    )
    return DecodedMap(
        column=column if axes != "rows" else None,
        row=row if axes != "columns" else None,
        modulation=np.full(dark.shape, 80, np.float32),
        flags=np.zeros(dark.shape, np.uint8),
        projector_width=400,
        projector_height=300,
        exposure_ms=None,
        emulated=False,
    )


def matched(first=IDEAL, second=IDEAL, pose=ASIDE, **words):
    maps = codes(first, RigidTransform(), **words), codes(second, pose, **words, seed=2)
    return maps, rectify(first, second, pose)


@pytest.mark.parametrize("axes", ["columns", "both"])
@pytest.mark.parametrize(
    ("first", "second", "pose"), [(IDEAL, IDEAL, ASIDE), (LENS, IDEAL, CONVERGING)]
)
def test_depth_of_a_step(axes, first, second, pose):
    maps, pair = matched(first, second, pose, axes=axes, noise=0.02)
    match = stereo_by_codes(*maps, pair, depth_limits_mm=LIMITS)
    error = np.linalg.norm(match.cloud.points - scene(first, RigidTransform()), axis=-1)
    error = error[match.cloud.valid]
    assert error.size > 0.55 * maps[0].flags.size
    assert np.median(error) < 0.15
    assert np.percentile(error, 99) < 1.0  # none between both surfaces
    assert sum(match.counts().values()) == maps[0].flags.size


def test_exact_codes_give_exact_depth():
    """Columns are linear in pixels on a plane that squarely faces the pair."""
    maps, pair = matched()
    cloud = match_codes(*maps, pair, depth_limits_mm=LIMITS)
    inner = cloud.points[20:130, 90:99]
    assert np.nanmedian(abs(inner[..., 2] - FAR_MM)) < 0.01


def test_what_the_second_camera_does_not_see_has_no_point():
    maps, pair = matched()
    hidden = codes(IDEAL, ASIDE)
    hidden = replace(hidden, column=np.where(np.arange(200) < 60, np.nan, hidden.column))
    match = stereo_by_codes(maps[0], hidden, pair, depth_limits_mm=LIMITS)
    all_of_it = stereo_by_codes(*maps, pair, depth_limits_mm=LIMITS)
    lost = all_of_it.cloud.valid & ~match.cloud.valid
    assert lost.sum() > 1000
    assert set(match.outcome[lost]) <= {MatchOutcome.NO_PARTNER, MatchOutcome.AMBIGUOUS}


def test_a_code_in_two_places_is_ambiguous_unless_the_other_axis_tells():
    """The far part of the second image shows the near part's columns once more."""
    for axes, expected in (("columns", MatchOutcome.AMBIGUOUS), ("both", MatchOutcome.MATCHED)):
        maps, pair = matched(axes=axes)
        column = maps[1].column.copy()
        column[60:64, 0:40] = column[60:64, 60:100]
        row = maps[1].row
        if row is not None:
            row = row.copy()
            row[60:64, 0:40] = 5.0
        twice = replace(maps[1], column=column, row=row)
        match = stereo_by_codes(maps[0], twice, pair, depth_limits_mm=(100.0, 5000.0))
        before = stereo_by_codes(*maps, pair, depth_limits_mm=LIMITS)
        where = np.zeros(match.outcome.shape, dtype=bool)
        where[61:63, 115:140] = before.cloud.valid[61:63, 115:140]
        assert where.sum() > 10
        assert (match.outcome[where] == expected).mean() > 0.9


def test_whole_codes_are_matched_in_their_middle():
    """Where a code covers several pixels of either image, the middles of both stretches match."""
    maps, pair = matched()
    coarse = [replace(each, column=np.floor(each.column / 4) * 4) for each in maps]
    cloud = match_codes(*coarse, pair, depth_limits_mm=LIMITS)
    assert np.nanmedian(abs(cloud.points[..., 2] - scene(IDEAL, RigidTransform())[..., 2])) < 6.0


def test_depth_limits():
    maps, pair = matched()
    match = stereo_by_codes(*maps, pair, depth_limits_mm=(500.0, 900.0))
    assert match.cloud.valid_points[:, 2].min() >= 500.0
    with pytest.raises(ImageError, match="0 < near < far"):
        match_codes(*maps, pair, depth_limits_mm=(500.0, 400.0))


def test_rows_that_do_not_correspond_are_a_contradiction():
    maps, pair = matched(axes="both")
    shifted = replace(maps[1], row=np.roll(maps[1].row, 4, axis=0), column=maps[1].column)
    with pytest.raises(ContradictionError, match=r"lies 4\.\d px off its row"):
        match_codes(maps[0], shifted, pair, depth_limits_mm=LIMITS)


def test_patterns_along_the_baseline_do_not_say_where():
    maps, pair = matched(axes="rows")
    with pytest.raises(ImageError, match="project patterns across"):
        match_codes(*maps, pair, depth_limits_mm=LIMITS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"projector_width": 800}, "same axes of the same patterns"),
        ({"column": None, "row": np.zeros((150, 200))}, "same axes of the same patterns"),
        ({"flags": np.zeros((75, 100), np.uint8)}, "the second image has 100 × 75 px, its camera"),
    ],
)
def test_maps_that_do_not_belong_together(change, message):
    maps, pair = matched()
    with pytest.raises(ImageError, match=message):
        match_codes(maps[0], replace(maps[1], **change), pair, depth_limits_mm=LIMITS)


def test_nothing_decoded_gives_no_point():
    maps, pair = matched()
    nothing = replace(maps[1], column=np.full_like(maps[1].column, np.nan))
    match = stereo_by_codes(maps[0], nothing, pair, depth_limits_mm=LIMITS)
    assert match.cloud.n_valid == 0
