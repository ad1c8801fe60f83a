from dataclasses import replace

import numpy as np

from exposight.cell import Cloud
from exposight.report.selection import exposures_ms
from exposight.report.skull.selection import (
    Crop,
    nominal_capture,
    object_crop,
    ring_values,
    sample_cloud,
)

WHOLE = Crop(top=0, bottom=90, left=0, right=120)


def test_the_nominal_capture_is_the_recorded_one(result):
    assert not nominal_capture(result).emulated


def test_exposures_are_those_of_the_table(result):
    assert exposures_ms(result) == (4.217, 10.0, 23.714)


def test_ring_values_are_the_tables(result):
    frame = result.table.frame
    for exposure_ms in exposures_ms(result):
        rows = frame.filter(frame["exposure_ms"] == exposure_ms)
        expected = dict(zip(rows["feature"], rows["p_norm"], strict=True))
        assert ring_values(result, exposure_ms) == expected


def test_sampling_is_even_and_only_of_valid_pixels(result):
    sample = sample_cloud(result, WHOLE, 1000)
    assert sample.step == 4  # 10 800 points / 1000 is between 3² and 4²
    assert set((sample.rows % 4).tolist()) == set((sample.columns % 4).tolist()) == {0}
    assert len(sample.rows) == 23 * 30
    assert result.cloud.valid[sample.rows, sample.columns].all()


def test_strays_in_depth_are_left_out(result):
    points = result.cloud.points.copy()
    points[5, 7, 2] = 900.0
    sample = sample_cloud(replace(result, cloud=Cloud(points=points)), WHOLE, 100_000)
    assert len(sample.rows) == points.shape[0] * points.shape[1] - 1
    assert not ((sample.rows == 5) & (sample.columns == 7)).any()


def test_points_outside_the_crop_are_left_out(result):
    sample = sample_cloud(result, Crop(top=10, bottom=20, left=30, right=50), 100_000)
    assert (sample.rows.min(), sample.rows.max()) == (10, 19)
    assert (sample.columns.min(), sample.columns.max()) == (30, 49)


def test_the_crop_holds_every_ring_whatever_the_cloud(result):
    empty = replace(result, cloud=Cloud(points=np.full((90, 120, 3), np.nan)))
    crop = object_crop(empty)
    for view in result.views:
        assert crop.top <= view.rows.min() <= view.rows.max() < crop.bottom
        assert crop.left <= view.columns.min() <= view.columns.max() < crop.right


def test_a_crop_cuts_rows_and_columns():
    image = np.arange(90 * 120).reshape(90, 120)
    crop = Crop(top=3, bottom=5, left=7, right=10)
    np.testing.assert_array_equal(crop.of(image), image[3:5, 7:10])
    assert (crop.height, crop.width) == (2, 3)
