"""Whole observations: what lowers p_norm and by how much, and campaigns."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import Cloud, Feature, MemoryCampaign, Part, RingTolerance
from exposight.errors import CloudError, ContradictionError
from exposight.geometry import RigidTransform
from exposight.observing import (
    SCHEMA,
    observe_campaign,
    observe_capture,
    point_search,
    view_features,
)

PIXEL_SHARE = 0.03
"""Pixels fall into a region at random at its border: a few per cent of some hundred pixels."""


@pytest.fixture
def ring(sensor, facing, hole):
    """The view of a hole of 20 mm on the axis."""
    (view,) = view_features(Part(name="part", features=(hole(20.0),)), sensor, facing)
    return view


# -- p_norm -------------------------------------------------------------------------------------


@pytest.mark.parametrize("missing", [1, 100, 400])
def test_missing_points_lower_p_norm_by_their_share(
    sensor, facing, ring, plate_cloud, make_capture, observe, hole, missing
):
    points = plate_cloud(sensor.camera, facing).points.copy()
    lost = np.random.default_rng(1).permutation(ring.n_pixels)[:missing]
    points[ring.rows[lost], ring.columns[lost]] = np.nan
    (row,) = observe(sensor, hole(20.0), make_capture(sensor, facing, cloud=Cloud(points=points)))
    assert row.n_points == ring.n_pixels - missing
    assert row.p_norm == (ring.n_pixels - missing) / ring.n_pixels


def test_all_zero_points_are_missing(sensor, facing, plate_cloud, make_capture, observe, hole):
    points = plate_cloud(sensor.camera, facing).points.copy()
    points[:, 320:] = 0.0
    (row,) = observe(sensor, hole(20.0), make_capture(sensor, facing, cloud=Cloud(points=points)))
    assert row.p_norm == pytest.approx(0.5, abs=PIXEL_SHARE)


def test_points_outside_the_ring_do_not_count(
    sensor, facing, ring, plate_cloud, make_capture, observe, hole
):
    points = np.full((sensor.camera.height, sensor.camera.width, 3), np.nan, dtype=np.float32)
    everywhere = plate_cloud(sensor.camera, facing).points
    inside = np.zeros(points.shape[:2], dtype=bool)
    inside[ring.rows, ring.columns] = True
    points[~inside] = everywhere[~inside]
    (row,) = observe(sensor, hole(20.0), make_capture(sensor, facing, cloud=Cloud(points=points)))
    assert row.n_points == 0


def test_the_same_cloud_unorganised_and_shuffled_gives_the_same_row(
    sensor, plate_cloud, make_capture, observe, hole
):
    tilted = RigidTransform.from_fanuc_wpr((5, 5, 590), 20, -10, 0)
    cloud = plate_cloud(sensor.camera, tilted)
    loose = Cloud(points=np.random.default_rng(0).permutation(cloud.points.reshape(-1, 3)))
    rows = [
        observe(sensor, hole(20.0), make_capture(sensor, tilted, cloud=each))
        for each in (cloud, loose)
    ]
    assert rows[0] == rows[1]


@pytest.mark.parametrize("depth_mm", [-9.0, -5.0, 5.0, 9.0])
def test_a_cloud_displaced_along_the_normal_is_seen_in_perspective(
    sensor, facing, plate_cloud, make_capture, observe, depth_mm
):
    deeper = RigidTransform(translation_mm=[0, 0, 600 + depth_mm])
    displaced = plate_cloud(sensor.camera, deeper)
    disc = Feature(
        name="p1", kind="surface_point", part_from_feature=RigidTransform(), radius_mm=60.0
    )
    (row,) = observe(sensor, disc, make_capture(sensor, facing, cloud=displaced))
    # 20 000 pixels, so that those at the border matter little
    assert row.p_norm == pytest.approx((600 / (600 + depth_mm)) ** 2, abs=0.003)


@pytest.mark.parametrize("depth_mm", [-11.0, 11.0])
def test_a_cloud_displaced_beyond_the_cylinders_height_has_no_point_in_it(
    sensor, facing, plate_cloud, make_capture, observe, hole, depth_mm
):
    deeper = RigidTransform(translation_mm=[0, 0, 600 + depth_mm])
    displaced = plate_cloud(sensor.camera, deeper)
    (row,) = observe(sensor, hole(20.0), make_capture(sensor, facing, cloud=displaced))
    assert row.p_norm == 0.0


@pytest.mark.parametrize(
    ("shift_mm", "lowers"), [(0.0, False), (2.5, False), (5.0, True), (10.0, True)]
)
def test_a_misaligned_part_lowers_p_norm_by_what_its_hole_takes_of_the_ring(
    sensor, facing, plate_cloud, make_capture, observe, hole, shift_mm, lowers
):
    """The ring begins 3 mm beside the hole: the paper's 5 mm errors of alignment reach it."""
    points = plate_cloud(sensor.camera, facing).points.copy()
    points[np.hypot(points[..., 0], points[..., 1]) < 20.0] = np.nan  # the hole itself
    believed = facing @ RigidTransform(translation_mm=[shift_mm, 0, 0])
    (row,) = observe(sensor, hole(20.0), make_capture(sensor, believed, cloud=Cloud(points=points)))
    radius, angle = np.meshgrid(np.linspace(23, 25, 200), np.linspace(0, 2 * np.pi, 2000))
    on_sheet = np.hypot(radius * np.cos(angle) + shift_mm, radius * np.sin(angle)) >= 20.0
    share = np.average(on_sheet, weights=radius)
    assert row.p_norm == pytest.approx(share, abs=PIXEL_SHARE)
    assert (row.p_norm < 0.95) is lowers


def test_another_tolerance_measures_another_ring(sensor, facing, make_capture, hole):
    campaign = MemoryCampaign(
        name="test",
        sensor=sensor,
        part=Part(name="part", features=(hole(20.0),)),
        captures=[make_capture(sensor, facing)],
    )
    wide = observe_campaign(campaign, RingTolerance(height_mm=20, inner_mm=2, outer_mm=12))
    area_px = np.pi * (32.0**2 - 22.0**2) * (sensor.camera.fx / 600) ** 2
    assert wide.frame["n_pixels"].item() == pytest.approx(area_px, rel=PIXEL_SHARE)
    assert wide.frame["p_norm"].item() == 1.0


# -- rows ---------------------------------------------------------------------------------------


def test_a_row_says_what_was_observed_when_and_where_from(
    sensor, facing, make_capture, observe, hole
):
    capture = make_capture(sensor, facing, view="left", exposure_ms=37.5, emulated=True)
    (row,) = observe(sensor, hole(20.0, name="f7"), capture)
    assert (row.feature, row.view, row.exposure_ms) == ("f7", "left", 37.5)
    assert (row.radius_mm, row.emulated, row.visibility) == (20.0, True, "visible")


def test_observe_capture_gives_the_rows_of_the_campaign(
    sensor, facing, make_capture, observe, hole
):
    features = (hole(20.0), hole(5.0, RigidTransform(translation_mm=[90, 0, 0]), "f2"))
    capture = make_capture(sensor, facing)
    views = view_features(Part(name="part", features=features), sensor, facing)
    rows = observe_capture(capture, views, point_search(capture.cloud, sensor.camera))
    shared = {
        "sensor": "small",
        "part": "part",
        "tcp": "0 0 600 0 0 0",
        **dict.fromkeys(("part_w_deg", "part_p_deg", "part_r_deg"), 0.0),
    }
    assert [replace(row, **shared) for row in rows] == observe(sensor, features, capture)


def test_rows_say_how_sensor_and_part_stand(sensor, make_capture, observe, hole):
    tilted = replace(
        sensor, camera_from_tcp=RigidTransform.from_fanuc_wpr((1.5, -2, 600), 10, 0, 0)
    )
    turn = RigidTransform.from_fanuc_wpr((0, 0, 0), 12, -7, 30)
    capture = make_capture(tilted, tilted.camera_from_tcp @ turn)
    (row,) = observe(tilted, replace(hole(20.0), finish="primer"), capture)
    assert (row.sensor, row.part, row.finish) == ("small", "part", "primer")
    assert row.tcp == "1.5 -2 600 10 0 0"
    assert (row.part_w_deg, row.part_p_deg, row.part_r_deg) == pytest.approx((12, -7, 30))


# -- campaigns ----------------------------------------------------------------------------------


@pytest.fixture
def campaign_of(sensor, hole):
    def campaign(*captures):
        return MemoryCampaign(
            name="door",
            sensor=sensor,
            part=Part(name="part", features=(hole(20.0), hole(20.0, BESIDE, "f2"))),
            captures=captures,
        )

    return campaign


BESIDE = RigidTransform(translation_mm=[90, 0, 0])
EMPTY = Cloud(points=np.full((10, 3), np.nan))


def test_a_campaign_gives_a_row_for_each_capture_and_feature(
    sensor, facing, make_capture, campaign_of
):
    captures = [make_capture(sensor, facing, exposure_ms=t) for t in (5.0, 10.0, 20.0)]
    table = observe_campaign(campaign_of(*captures))
    assert table.frame.schema == SCHEMA
    assert table.names("feature").tolist() == ["f1", "f2"] * 3
    assert table.array(["exposure_ms"])[:, 0].tolist() == [5, 5, 10, 10, 20, 20]


def test_clouds_in_metres_are_refused(sensor, facing, make_capture, campaign_of):
    dark = make_capture(sensor, facing, view="dark", cloud=EMPTY)
    cloud = Cloud(points=1e-3 * make_capture(sensor, facing).cloud.points)
    with pytest.raises(ContradictionError, match=r"599 mm nearer.*in m: --cloud-unit m"):
        observe_campaign(campaign_of(dark, make_capture(sensor, facing, cloud=cloud)))


def test_every_view_has_masks_of_its_own(sensor, facing, make_capture, campaign_of):
    turned = RigidTransform.from_fanuc_wpr((20, 0, 600), 0, 25, 0)
    captures = [
        make_capture(sensor, facing, view="a"),
        make_capture(sensor, turned, view="b"),
        make_capture(sensor, facing, view="c"),
    ]
    table = observe_campaign(campaign_of(*captures))
    n_pixels = table.frame["n_pixels"].to_list()
    assert n_pixels[:2] == n_pixels[4:] != n_pixels[2:4]
    assert table.frame["p_norm"].to_list() == [1.0] * 6


def test_progress_is_told_after_each_capture(sensor, facing, make_capture, campaign_of):
    captures = [make_capture(sensor, facing, exposure_ms=t) for t in (5.0, 10.0)]
    steps = []
    observe_campaign(campaign_of(*captures), progress=lambda *step: steps.append(step[1:]))
    assert steps == [(1, 2), (2, 2)]


def test_one_dark_capture_is_an_observation_of_p_norm_zero(
    sensor, facing, make_capture, campaign_of
):
    dark = make_capture(sensor, facing, exposure_ms=1.0, cloud=EMPTY)
    table = observe_campaign(campaign_of(dark, make_capture(sensor, facing)))
    assert table.frame["p_norm"].to_list() == [0.0, 0.0, 1.0, 1.0]
    assert len(table.measured()) == 4


def test_a_campaign_without_a_single_point_is_an_error(sensor, facing, make_capture, campaign_of):
    captures = [make_capture(sensor, facing, exposure_ms=t, cloud=EMPTY) for t in (5.0, 10.0)]
    with pytest.raises(
        CloudError, match=r"campaign 'door': none of its 2 clouds has a valid point.*in mm"
    ):
        observe_campaign(campaign_of(*captures))


def test_a_campaign_without_captures_gives_an_empty_table(campaign_of):
    table = observe_campaign(campaign_of())
    assert len(table) == 0
    assert table.frame.schema == SCHEMA


def test_rows_become_columns_in_batches_without_a_difference(
    sensor, facing, make_capture, campaign_of, monkeypatch
):
    captures = [make_capture(sensor, facing, exposure_ms=float(ms)) for ms in (10, 20, 30, 40, 50)]
    whole = observe_campaign(campaign_of(*captures)).frame
    monkeypatch.setattr("exposight.observing.observe._ROWS_AT_ONCE", 2)
    assert observe_campaign(campaign_of(*captures)).frame.equals(whole)
