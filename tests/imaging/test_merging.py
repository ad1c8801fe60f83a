"""Merging exposures: each pixel from the exposure that has it best, and nothing invented."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exposight.cell import Capture, Cloud, StackImages
from exposight.cell.capture import read_capture, write_capture
from exposight.errors import CloudError, ExposightError, ImageError, InputError, PoseError
from exposight.geometry import RigidTransform
from exposight.imaging import merge_captures, merge_record

NAN = np.nan


def _capture(exposure_ms: float, image, depth, maximum=None, swing=None, **changes) -> Capture:
    image = np.atleast_2d(np.array(image, dtype=np.uint8))
    depth = np.atleast_2d(np.array(depth, dtype=np.float32))
    stack = None
    if maximum is not None:
        maximum, swing = (np.atleast_2d(np.array(each, np.uint8)) for each in (maximum, swing))
        stack = StackImages(mean=image, maximum=maximum, modulation=swing, min_modulation=9.0)
    points = np.stack([depth * 0.1, depth * 0.2, depth], axis=-1)
    fields = {"camera_from_part": RigidTransform(translation_mm=np.array([0.0, 0.0, 600.0]))}
    return Capture(
        view="v",
        exposure_ms=exposure_ms,
        image=image,
        cloud=Cloud(points=points),
        stack=stack,
        **{**fields, **changes},
    )


#        both good · long clips · short dark · neither
SHORT = _capture(5, [40, 90, 4, 1], [601, 602, NAN, NAN], [60, 120, 6, 2], [30, 70, 3, 1])
LONG = _capture(50, [120, 255, 40, 9], [701, NAN, 703, NAN], [200, 255, 60, 14], [110, 5, 33, 8])


def test_each_pixel_is_from_the_exposure_that_has_it_best() -> None:
    merged = merge_captures([SHORT, LONG])
    assert merged.cloud.points[0, :3, 2].tolist() == [701.0, 602.0, 703.0]
    assert not merged.cloud.valid[0, 3]
    assert merged.image.tolist() == [[120, 90, 40, 9]]
    assert merged.stack.maximum.tolist() == [[200, 120, 60, 14]]
    assert merged.stack.modulation.tolist() == [[110, 70, 33, 8]]
    assert merged.stack.min_modulation == 9.0
    record = merge_record(merged)
    assert record.exposures_ms == (5.0, 50.0)
    assert record.points == (1, 2)
    assert record.criterion == "modulation"


def test_a_clipped_pixel_gives_way_to_a_weaker_one_but_not_to_none() -> None:
    short = _capture(5, [9, 9], [601, NAN], [20, 20], [19, 2])
    clipped = _capture(50, [99, 99], [701, 702], [255, 255], [200, 200])
    assert merge_captures([short, clipped]).cloud.points[0, :, 2].tolist() == [601.0, 702.0]


def test_without_stacks_the_brightest_grey_level_that_does_not_clip_decides() -> None:
    short, long = (replace(each, stack=None) for each in (SHORT, LONG))
    merged = merge_captures([short, LONG])  # one stack alone tells nothing
    assert merge_record(merged).criterion == "grey level"
    assert merged.stack is None
    assert merged.cloud.points[0, :3, 2].tolist() == [701.0, 602.0, 703.0]
    assert merge_captures([short, long]).image.tolist() == [[120, 90, 40, 9]]


def test_where_points_standard_deviation_is_observed_it_decides() -> None:
    deviations = [np.array([[0.01, 0.1, NAN, NAN]]), np.array([[0.02, NAN, 0.1, NAN]])]
    merged = merge_captures([LONG, SHORT], deviations_mm=deviations[::-1])
    assert merge_record(merged).criterion == "standard deviation"
    assert merged.cloud.points[0, :3, 2].tolist() == [601.0, 602.0, 703.0]


def test_standard_deviations_stay_with_the_points_that_were_taken(tmp_path) -> None:
    known = [
        replace(each, cloud=Cloud(points=each.cloud.points, sigma_z_mm=np.full((1, 4), sigma)))
        for each, sigma in ((SHORT, 0.25), (LONG, 0.5))
    ]
    write_capture(tmp_path / "c", merge_captures(known))
    sigma_mm = read_capture(tmp_path / "c").cloud.sigma_z_mm
    np.testing.assert_array_equal(sigma_mm, [[0.5, 0.25, 0.5, NAN]])
    assert merge_captures([SHORT, known[1]]).cloud.sigma_z_mm is None
    plain, with_sigma = tmp_path / "plain", tmp_path / "with"
    write_capture(plain, SHORT)
    write_capture(with_sigma, known[0])
    assert '"version": 3' in (plain / "capture.json").read_text()  # for older versions
    assert '"version": 5' in (with_sigma / "capture.json").read_text()


def test_a_merged_capture_does_not_pretend_to_be_one_exposure(tmp_path) -> None:
    merged = merge_captures([LONG, SHORT])
    assert merged.brightness_source == "merged"
    assert merged.exposure_ms == 50.0
    assert "5, 50 ms" in merged.notes
    write_capture(tmp_path / "c", merged)
    again = read_capture(tmp_path / "c")
    assert merge_record(again) == merge_record(merged)
    assert merge_record(SHORT) is None


def test_one_capture_stays_as_it_is() -> None:
    assert merge_captures([SHORT]) is SHORT


@given(seed=st.integers(0, 10**6), order=st.permutations([0, 1, 2]))
def test_the_order_of_captures_does_not_matter_and_no_point_is_lost(seed, order) -> None:
    rng = np.random.default_rng(seed)
    captures = []
    for time_ms in (2, 8, 32):
        depth = np.where(rng.random((4, 5)) < 0.4, np.nan, rng.uniform(500, 700, (4, 5)))
        maximum = rng.choice([30, 100, 255], (4, 5))
        swing = np.minimum(rng.integers(0, 90, (4, 5)), maximum)
        captures.append(_capture(time_ms, maximum // 2, depth, maximum, swing))
    merged = merge_captures(captures)
    other = merge_captures([captures[i] for i in order])
    assert np.array_equal(merged.cloud.points, other.cloud.points, equal_nan=True)
    assert np.array_equal(merged.image, other.image)
    valid = np.stack([capture.cloud.valid for capture in captures])
    assert np.array_equal(merged.cloud.valid, valid.any(axis=0))
    depths = np.stack([capture.cloud.points[..., 2] for capture in captures])
    depth = merged.cloud.points[..., 2]
    assert ((depths == depth) | ~merged.cloud.valid).any(axis=0).all()


def _moved(x_mm: float) -> RigidTransform:
    return RigidTransform(translation_mm=np.array([x_mm, 0.0, 600.0]))


@pytest.mark.parametrize(
    ("other", "error", "fact"),
    [
        (replace(LONG, camera_from_part=_moved(0.2)), PoseError, "0.2 mm"),
        (
            replace(
                LONG,
                camera_from_part=RigidTransform.from_fanuc_wpr((0, 0, 600), 0.0, 0.02, 0.0),
            ),
            PoseError,
            "0.02°",
        ),
        (replace(LONG, view="w"), InputError, "'w'"),
        (replace(LONG, exposure_ms=5.0), InputError, "5 ms"),
        (replace(LONG, cloud=None), CloudError, "without its cloud"),
        (replace(LONG, cloud=Cloud(points=np.ones((4, 3)))), CloudError, "organised"),
        (_capture(50, [1, 2], [600, 600]), ImageError, "1 × 2 px"),
        (merge_captures([LONG, _capture(70, [1] * 4, [600] * 4)]), InputError, "merged already"),
    ],
)
def test_captures_that_contradict_each_other(
    other: Capture, error: type[ExposightError], fact: str
) -> None:
    with pytest.raises(error, match=fact):
        merge_captures([SHORT, other])


def test_a_pose_that_is_read_back_anew_is_the_same() -> None:
    merged = merge_captures([SHORT, replace(LONG, camera_from_part=_moved(0.01))])
    assert merged.camera_from_part == SHORT.camera_from_part


def test_nothing_to_merge() -> None:
    with pytest.raises(InputError, match="nothing to merge"):
        merge_captures([])
    with pytest.raises(InputError, match="got 1"):
        merge_captures([SHORT, LONG], deviations_mm=[np.ones((1, 4))])
    with pytest.raises(InputError, match="must be"):
        merge_captures([SHORT, LONG], deviations_mm=[np.ones((2, 4))] * 2)
