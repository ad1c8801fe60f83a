"""A perforated sheet measured by plan: the same by whomever, whole or in part, and what is kept."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import polars as pl
import pytest

from exposight.cell import CampaignFolder, CampaignWriter, sensor_preset
from exposight.cell.capture import read_capture, write_capture
from exposight.errors import (
    CloudError,
    DamagedFileError,
    FeatureError,
    FileError,
    InputError,
    SensorError,
)
from exposight.geometry import read_projector_camera
from exposight.imaging import (
    decode,
    match_pair,
    read_recording,
    read_sequence,
    rectify,
    triangulate,
)
from exposight.measuring import measure, measure_observations, recorded_driver
from exposight.observing import observe_campaign, read_observations
from exposight.plans import DepthPlane, MeasuringPlan, read_plan
from exposight.twin.sensors.settings import DOT_DEPTHS_MM, STRIPE_LIMITS

STEREO = MeasuringPlan(
    name="stereo sheet",
    sensor=sensor_preset("rc-visard-65"),
    features=("h0", "h1"),
    reference="h0",
    planes=(
        DepthPlane(name="middle", z_tcp_mm=0.0, x_mm=(0.0,), y_mm=(0.0,), exposures_ms=(9.0,)),
    ),
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, cell, one_view) -> CampaignFolder:
    """One view in whole frames."""
    driver = cell(one_view, rings_only=False)
    return measure(one_view, driver, tmp_path_factory.mktemp("whole"))


# -- the same, however it is done ---------------------------------------------------------------


def test_a_plan_becomes_a_campaign_in_its_order(alone):
    campaign = CampaignFolder(alone)
    views = [f"middle-x{i}-y{j}" for j in (1, 2) for i in (1, 2)]
    assert campaign.keys() == tuple((view, t) for view in views for t in (30.0, 330.0))
    assert campaign.name == "sheet"
    assert [feature.name for feature in campaign.part.features] == ["h0", "h1"]


def test_notes_tell_how_a_view_was_aligned_and_what_was_taken(alone):
    notes = [capture.notes for capture in CampaignFolder(alone).captures()]
    assert {note.split(",")[0] for note in notes} == {
        "aligned by kinematics",
        "aligned by photogrammetry",
    }
    assert all(note.endswith("only the neighbourhoods of the rings were taken") for note in notes)


@pytest.mark.slow
def test_four_workers_give_the_same_bytes_as_one(
    tmp_path, alone, cell, sheet_plan, content, reports
):
    driver = cell(sheet_plan)
    folder = measure(sheet_plan, driver, tmp_path / "four", workers=4, progress=reports).path
    assert content(folder) == content(alone)
    assert reports == [(done, 8) for done in (0, 2, 4, 6, 8)]


@pytest.mark.slow
def test_rings_only_measure_the_same_as_whole_frames(whole, alone):
    rings = observe_campaign(CampaignFolder(alone)).frame
    same_view = rings.filter(rings["view"] == "middle-x1-y1")
    assert observe_campaign(whole).frame.equals(same_view)
    assert same_view["p_norm"].is_between(0.02, 0.98).any()  # not only all or nothing


@pytest.mark.slow
def test_whole_frames_are_organised(whole):
    captures = list(whole.captures())
    assert all(capture.cloud.organised for capture in captures)
    assert max(capture.cloud.n_valid for capture in captures) > 10_000


@pytest.mark.slow
def test_observing_at_once_equals_observing_the_campaign(alone, cell, sheet_plan, reports):
    table = measure_observations(sheet_plan, cell(sheet_plan), workers=2, progress=reports)
    assert table.frame.equals(observe_campaign(CampaignFolder(alone)).frame)
    assert reports[-1] == (8, 8)


def test_active_stereo_is_taken_in_whole_frames(tmp_path, cell):
    campaign = measure(STEREO, cell(STEREO, rings_only=False), tmp_path / "one")
    captures = list(campaign.captures())
    assert campaign.keys() == (("middle-x1-y1", 9),)
    assert captures[0].cloud.organised
    assert captures[0].cloud.n_valid > 10_000


# -- what is kept -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cloudless(tmp_path_factory, sheet_plan, cell) -> CampaignFolder:
    """The plan by two workers, without clouds."""
    folder = tmp_path_factory.mktemp("cloudless")
    return measure(sheet_plan, cell(sheet_plan), folder, clouds=False, workers=2)


@pytest.mark.slow
def test_without_clouds_images_and_poses_are_the_same(cloudless, alone):
    for capture, whole in zip(cloudless.captures(), CampaignFolder(alone).captures(), strict=True):
        assert capture.cloud is None
        assert capture.key == whole.key
        assert np.array_equal(capture.image, whole.image)
        assert np.array_equal(capture.stack.maximum, whole.stack.maximum)
        assert capture.camera_from_part == whole.camera_from_part
    assert not list(cloudless.path.rglob("cloud.npz"))


@pytest.mark.slow
def test_without_clouds_the_observations_lie_in_the_campaign(cloudless, alone):
    table = read_observations(cloudless.path / "observations.csv")
    assert table.frame.equals(observe_campaign(CampaignFolder(alone)).frame)


@pytest.mark.slow
def test_what_was_kept_without_clouds_is_not_observed_again(cloudless):
    message = "view 'middle-x1-y1' at 30 ms was kept without its cloud.*see observations.csv"
    with pytest.raises(CloudError, match=message):
        observe_campaign(cloudless)


@pytest.mark.slow
def test_a_campaign_without_clouds_goes_on(tmp_path, cloudless, sheet_plan, cell, content):
    folder = tmp_path / "campaign"
    shutil.copytree(cloudless.path, folder)
    shutil.rmtree(folder / "captures" / "000003")
    (folder / "observations.csv").unlink()
    measure(sheet_plan, cell(sheet_plan), folder, clouds=False)
    assert content(folder) == content(cloudless.path)


@pytest.mark.slow
def test_observations_of_an_earlier_version_are_gone_on_with(tmp_path, cloudless, sheet_plan, cell):
    """Its captures' rows have fewer columns than those that are taken now."""
    shutil.copytree(cloudless.path, tmp_path / "campaign")
    folder = tmp_path / "campaign" / "captures"
    shutil.rmtree(folder / "000003")
    first = read_capture(folder / "000000")
    rows = pl.read_csv(first.attachments["observations.csv"], infer_schema=False)
    old = rows[:, : rows.columns.index("emulated") + 1].write_csv().encode()
    shutil.rmtree(folder / "000000")
    write_capture(folder / "000000", replace(first, attachments={"observations.csv": old}))
    campaign = measure(sheet_plan, cell(sheet_plan), tmp_path / "campaign", clouds=False)
    table, whole = (
        read_observations(each.path / "observations.csv").frame for each in (campaign, cloudless)
    )
    new = rows.columns[rows.columns.index("emulated") + 1 :]
    assert table.drop(new).equals(whole.drop(new))
    assert table["i_mean"].null_count() > whole["i_mean"].null_count()


@pytest.mark.parametrize("rings_only", [False, True])
@pytest.mark.slow
def test_raw_frames_decode_to_the_very_cloud(tmp_path, rings_only, one_view, cell):
    driver = cell(one_view, rings_only=rings_only, raw_frames=True)
    campaign = measure(one_view, driver, tmp_path)
    (capture, _) = campaign.captures()
    sequence = read_sequence(tmp_path / "sequence.toml")
    stack = read_recording(tmp_path / "captures" / "000000", sequence)
    rig = campaign.sensor
    cloud = triangulate(
        decode(stack, sequence, STRIPE_LIMITS),
        camera=rig.camera,
        projector=rig.projector.camera,
        projector_from_camera=rig.projector.camera_from_projector.inverse(),
    )
    if not rings_only:
        np.testing.assert_array_equal(cloud.points, capture.cloud.points)
    # The boxes' points come box by box.
    found, expected = (np.unique(c.valid_points, axis=0) for c in (cloud, capture.cloud))
    np.testing.assert_array_equal(found, expected)
    assert len(found) > 1000


def test_raw_frames_come_with_the_calibration_that_decode_reads(tmp_path, one_view, cell):
    campaign = measure(one_view, cell(one_view, raw_frames=True), tmp_path)
    read = read_projector_camera(tmp_path / "calibration.yml")
    projector = campaign.sensor.projector
    assert read.camera.matrix == pytest.approx(campaign.sensor.camera.matrix, rel=1e-15)
    assert read.projector.matrix == pytest.approx(projector.camera.matrix, rel=1e-15)
    assert read.camera.width == campaign.sensor.camera.width
    moved = read.projector_from_camera @ projector.camera_from_projector
    np.testing.assert_allclose(moved.to_matrix(), np.eye(4), atol=1e-12)


def test_frames_are_checksummed(tmp_path, one_view, cell):
    campaign = measure(one_view, cell(one_view, raw_frames=True), tmp_path)
    assert [*campaign.attachments(0)] == [f"frame-{i:02d}.png" for i in range(12)]
    frame = tmp_path / "captures" / "000000" / "frame-07.png"
    frame.write_bytes(frame.read_bytes()[:-1] + b"x")
    with pytest.raises(DamagedFileError, match=r"frame-07\.png is damaged"):
        [*campaign.attachments(0).values()]


@pytest.mark.slow
def test_frames_of_a_stereo_sensor_are_both_images(tmp_path, cell):
    campaign = measure(STEREO, cell(STEREO, rings_only=False, raw_frames=True), tmp_path)
    (capture,) = campaign.captures()
    frames = [
        cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        for content in campaign.attachments(0).values()
    ]
    assert np.array_equal(frames[0], capture.image)
    pair = rectify(*campaign.sensor.cameras, campaign.sensor.first_from_camera[1])
    cloud = match_pair(*frames, pair, depth_limits_mm=DOT_DEPTHS_MM)
    np.testing.assert_array_equal(cloud.points, capture.cloud.points)


def test_a_campaign_goes_on_with_the_same_choices_only(alone, sheet_plan, cell):
    with pytest.raises(InputError, match="measured with clouds kept, not without; go on with that"):
        measure(sheet_plan, cell(sheet_plan), alone, clouds=False)
    with pytest.raises(InputError, match=r"measured with .* differing in raw_frames"):
        measure(sheet_plan, cell(sheet_plan, raw_frames=True), alone)


def test_the_driver_is_on_record(alone, tmp_path):
    assert recorded_driver(alone) == "simulated cell"
    assert recorded_driver(tmp_path) is None


def test_a_simulation_of_an_older_version_opens_and_is_not_mixed(tmp_path, alone, sheet_plan, cell):
    folder = tmp_path / "old"
    shutil.copytree(alone, folder)
    (folder / "measurement.json").unlink()
    (folder / "simulation.json").write_text("{}")
    assert observe_campaign(CampaignFolder(folder)).frame.equals(
        observe_campaign(CampaignFolder(alone)).frame
    )
    assert recorded_driver(folder) == "simulated cell"
    with pytest.raises(InputError, match=r"an earlier version .* cannot continue"):
        measure(sheet_plan, cell(sheet_plan), folder)


# -- what cannot be -----------------------------------------------------------------------------


def test_the_folder_of_another_plan_is_refused(
    tmp_path, alone, cell, sheet_plan, one_view, content
):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    for other, difference in (
        (
            replace(sheet_plan, seed=9),
            "another plan, differing in seed; go on with that, or choose",
        ),
        (one_view, "another plan, differing in planes"),
    ):
        with pytest.raises(InputError, match=difference):
            measure(other, cell(other), folder)
    with pytest.raises(InputError, match="'sheet' and not 'roof'"):
        measure(replace(sheet_plan, name="roof"), cell(sheet_plan), folder)
    assert content(folder) == content(alone)


def test_a_cell_of_other_settings_is_refused(alone, cell, sheet_plan, sheet_scene):
    for changes, fact in (
        ({"lighting": "III"}, "measured with another driver .* lighting;"),
        ({"rings_only": False}, "measured with another driver .* rings_only;"),
        ({"scene": sheet_scene("bare")}, "'h0' was on 'primer' and is on 'bare' now;"),
    ):
        with pytest.raises(InputError, match=fact):
            measure(sheet_plan, cell(sheet_plan, **changes), alone)


def test_captures_of_no_plan_are_refused(tmp_path, alone, cell, sheet_plan):
    whole = CampaignFolder(alone)
    recorded = replace(next(whole.captures()), view="recorded")
    with CampaignWriter.open_or_create(
        tmp_path / "cell", name=sheet_plan.name, sensor=whole.sensor, part=whole.part
    ) as writer:
        writer.add(recorded)
    with pytest.raises(InputError, match=r"1 captures and no measurement\.json: they were not"):
        measure(sheet_plan, cell(sheet_plan), tmp_path / "cell")


def test_captures_added_by_hand_are_refused(tmp_path, alone, cell, sheet_plan):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    (folder / "captures" / "000003").rename(folder / "captures" / "000009")
    with pytest.raises(InputError, match="at 330 ms as capture 9, which this plan does not"):
        measure(sheet_plan, cell(sheet_plan), folder)


def test_the_plan_lies_in_the_folder(alone, sheet_plan):
    assert read_plan(alone / "plan.toml") == sheet_plan


@pytest.mark.slow
def test_an_error_in_a_worker_names_plan_view_and_capture(tmp_path, cell, sheet_plan):
    def block(stage: str, done: int, _total: int) -> None:
        if (stage, done) == ("measuring", 0):
            (tmp_path / "captures" / "000005").mkdir()

    message = r"plan 'sheet', view 'middle-x1-y2' at 330 ms: .*000005 was not written: File exists"
    with pytest.raises(FileError, match=message):
        measure(sheet_plan, cell(sheet_plan), tmp_path, workers=2, progress=block)


def test_errors_of_the_plan_come_before_any_folder(tmp_path, cell, sheet_plan):
    folder, plane, driver = tmp_path / "campaign", sheet_plan.planes[0], cell(sheet_plan)
    for plan, error, message in (
        (replace(sheet_plan, features=("h7",)), FeatureError, "plan 'sheet': .*'h7'"),
        (
            replace(sheet_plan, planes=(replace(plane, x_mm=(900.0,)),)),
            InputError,
            "view 'middle-x1-y1' sees none of its features",
        ),
        (
            replace(sheet_plan, planes=(replace(plane, exposures_ms=(2000.0,)),)),
            SensorError,
            "'middle'.*from 1 to 1000 ms, got 2000 ms",
        ),
    ):
        with pytest.raises(error, match=message):
            measure(plan, driver, folder)
        with pytest.raises(error, match=message):
            measure_observations(plan, driver)
    assert not folder.exists()


def test_no_worker_is_refused(sheet_plan, cell):
    with pytest.raises(InputError, match="at least 1 worker, got 0"):
        measure_observations(sheet_plan, cell(sheet_plan), workers=0)


# -- drivers other than the simulated cell ------------------------------------------------------


class SlowCell:
    """A cell with one robot: takes captures of the simulated one, its own way."""

    def __init__(self, cell, *, offset_ms=0.0, error=None, name=None):
        self.sensor = cell.sensor
        self.asked = []
        self._cell, self._offset_ms, self._error, self._name = cell, offset_ms, error, name

    def capture(self, exposure_ms, camera_from_part, *, view):
        self.asked.append((view, exposure_ms))
        if self._error is not None and len(self.asked) == 4:
            raise self._error
        capture = self._cell.capture(exposure_ms, camera_from_part, view=view)
        return replace(
            capture, exposure_ms=exposure_ms + self._offset_ms, view=self._name or capture.view
        )


def test_a_driver_that_fails_costs_no_capture(tmp_path, cell, sheet_plan, alone):
    simulated = cell(sheet_plan)
    broken = SlowCell(simulated, error=OSError("no route to host"))
    message = r"'middle-x2-y1' at 330 ms: the driver failed \(OSError: no route to host\)"
    with pytest.raises(SensorError, match=message):
        measure(sheet_plan, broken, tmp_path, part=simulated.part)
    assert len(CampaignFolder(tmp_path)) == 3
    mended = SlowCell(simulated)
    campaign = measure(sheet_plan, mended, tmp_path, part=simulated.part, workers=4)
    assert len(mended.asked) == 5
    assert observe_campaign(campaign).frame.equals(observe_campaign(CampaignFolder(alone)).frame)
    assert recorded_driver(tmp_path) == "SlowCell"


def test_an_exposure_read_back_is_kept_and_gone_on_with(tmp_path, cell, sheet_plan, reports):
    simulated = cell(sheet_plan)
    driver = SlowCell(simulated, offset_ms=0.4)
    measure(sheet_plan, driver, tmp_path, part=simulated.part)
    campaign = measure(sheet_plan, driver, tmp_path, part=simulated.part, progress=reports)
    assert reports == [(8, 8)]
    assert [capture.exposure_ms for capture in campaign.captures()] == [30.4, 330.4] * 4


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"offset_ms": 1.5}, "set to 30 ms and took 31.5 ms, more than its increment of 1 ms"),
        ({"name": "elsewhere"}, "named its capture 'elsewhere'"),
    ],
)
def test_a_capture_other_than_asked_for_is_refused(tmp_path, cell, sheet_plan, wrong, message):
    simulated = cell(sheet_plan)
    with pytest.raises(InputError, match=message):
        measure(sheet_plan, SlowCell(simulated, **wrong), tmp_path, part=simulated.part)
    assert len(CampaignFolder(tmp_path)) == 0


def test_a_driver_must_know_the_part_or_be_told(tmp_path, cell, sheet_plan):
    with pytest.raises(InputError, match="does not know the part"):
        measure(sheet_plan, SlowCell(cell(sheet_plan)), tmp_path)


def test_a_driver_of_another_sensor_is_refused(tmp_path, cell, sheet_plan, small_sensor):
    plan = replace(sheet_plan, sensor=small_sensor)
    with pytest.raises(SensorError, match="differs in cameras; plan for the driver's sensor"):
        measure(plan, cell(sheet_plan), tmp_path)


def test_a_driver_that_is_not_concurrent_is_not_for_a_cluster(tmp_path, cell, sheet_plan):
    with pytest.raises(InputError, match="in this process alone"):
        measure(sheet_plan, SlowCell(cell(sheet_plan)), tmp_path, cluster="tcp://127.0.0.1:8786")
