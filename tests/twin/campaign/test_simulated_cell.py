"""A perforated sheet measured by plan: the same by whomever, whole or in part, and what is kept."""

import hashlib
import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from exposight.cell import CampaignFolder, CampaignWriter
from exposight.errors import (
    CloudError,
    DamagedFileError,
    FeatureError,
    FileError,
    InputError,
    MissingFileError,
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
from exposight.observing import observe_campaign, read_observations
from exposight.twin import (
    CellSettings,
    DepthPlane,
    MeasuringPlan,
    read_plan,
    simulate,
    simulate_observations,
)
from exposight.twin.sensors import LIMITS
from exposight.twin.sensors.active_stereo import MATCHED_MM

STEREO = MeasuringPlan(
    name="stereo sheet",
    sensor="rc-visard-65",
    features=("h0", "h1"),
    reference="h0",
    planes=(
        DepthPlane(name="middle", z_tcp_mm=0.0, x_mm=(0.0,), y_mm=(0.0,), exposures_ms=(9.0,)),
    ),
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, scene, one_view) -> CampaignFolder:
    """One view in whole frames."""
    return simulate(one_view, tmp_path_factory.mktemp("whole"), CellSettings(scene=scene))


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


def test_four_workers_give_the_same_bytes_as_one(tmp_path, alone, rings, sheet_plan, content):
    reports = []
    folder = simulate(
        sheet_plan, tmp_path / "four", replace(rings, workers=4), lambda *n: reports.append(n)
    ).path
    assert content(folder) == content(alone)
    assert reports == [(done, 8) for done in (0, 2, 4, 6, 8)]


def test_rings_only_measure_the_same_as_whole_frames(whole, alone, rings):
    rings = observe_campaign(CampaignFolder(alone)).frame
    same_view = rings.filter(rings["view"] == "middle-x1-y1")
    assert observe_campaign(whole).frame.equals(same_view)
    assert same_view["p_norm"].is_between(0.02, 0.98).any()  # not only all or nothing


def test_whole_frames_are_organised(whole):
    captures = list(whole.captures())
    assert all(capture.cloud.organised for capture in captures)
    assert max(capture.cloud.n_valid for capture in captures) > 10_000


def test_observing_at_once_equals_observing_the_campaign(alone, rings, sheet_plan):
    reports = []
    table = simulate_observations(
        sheet_plan, replace(rings, workers=2), lambda *n: reports.append(n)
    )
    assert table.frame.equals(observe_campaign(CampaignFolder(alone)).frame)
    assert reports[-1] == (8, 8)


def test_active_stereo_is_taken_in_whole_frames(tmp_path, scene):
    campaign = simulate(STEREO, tmp_path / "one", CellSettings(scene=scene))
    captures = list(campaign.captures())
    assert campaign.keys() == (("middle-x1-y1", 9),)
    assert captures[0].cloud.organised
    assert captures[0].cloud.n_valid > 10_000


# -- what is kept -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cloudless(tmp_path_factory, sheet_plan, rings) -> CampaignFolder:
    """The plan by two workers, without clouds."""
    settings = replace(rings, clouds=False, workers=2)
    return simulate(sheet_plan, tmp_path_factory.mktemp("cloudless"), settings)


def test_without_clouds_images_and_poses_are_the_same(cloudless, alone):
    for capture, whole in zip(cloudless.captures(), CampaignFolder(alone).captures(), strict=True):
        assert capture.cloud is None
        assert capture.key == whole.key
        assert np.array_equal(capture.image, whole.image)
        assert capture.camera_from_part == whole.camera_from_part
    assert not list(cloudless.path.rglob("cloud.npz"))


def test_without_clouds_the_observations_lie_in_the_campaign(cloudless, alone):
    table = read_observations(cloudless.path / "observations.csv")
    assert table.frame.equals(observe_campaign(CampaignFolder(alone)).frame)


def test_what_was_kept_without_clouds_is_not_observed_again(cloudless):
    message = "view 'middle-x1-y1' at 30 ms was kept without its cloud.*see observations.csv"
    with pytest.raises(CloudError, match=message):
        observe_campaign(cloudless)


def test_a_campaign_without_clouds_goes_on(tmp_path, cloudless, sheet_plan, rings, content):
    folder = tmp_path / "campaign"
    shutil.copytree(cloudless.path, folder)
    shutil.rmtree(folder / "captures" / "000003")
    (folder / "observations.csv").unlink()
    simulate(sheet_plan, folder, replace(rings, clouds=False))
    assert content(folder) == content(cloudless.path)


@pytest.mark.parametrize("rings_only", [False, True])
def test_raw_frames_decode_to_the_very_cloud(tmp_path, rings_only, one_view, scene):
    settings = CellSettings(rings_only=rings_only, raw_frames=True, scene=scene)
    campaign = simulate(one_view, tmp_path, settings)
    (capture, _) = campaign.captures()
    sequence = read_sequence(tmp_path / "sequence.toml")
    stack = read_recording(tmp_path / "captures" / "000000", sequence)
    rig = campaign.sensor
    cloud = triangulate(
        decode(stack, sequence, LIMITS),
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


def test_raw_frames_come_with_the_calibration_that_decode_reads(tmp_path, one_view, rings):
    campaign = simulate(one_view, tmp_path, replace(rings, raw_frames=True))
    read = read_projector_camera(tmp_path / "calibration.yml")
    projector = campaign.sensor.projector
    assert read.camera.matrix == pytest.approx(campaign.sensor.camera.matrix, rel=1e-15)
    assert read.projector.matrix == pytest.approx(projector.camera.matrix, rel=1e-15)
    assert read.camera.width == campaign.sensor.camera.width
    moved = read.projector_from_camera @ projector.camera_from_projector
    np.testing.assert_allclose(moved.to_matrix(), np.eye(4), atol=1e-12)


def test_frames_are_checksummed(tmp_path, one_view, rings):
    campaign = simulate(one_view, tmp_path, replace(rings, raw_frames=True))
    assert [*campaign.attachments(0)] == [f"frame-{i:02d}.png" for i in range(12)]
    frame = tmp_path / "captures" / "000000" / "frame-07.png"
    frame.write_bytes(frame.read_bytes()[:-1] + b"x")
    with pytest.raises(DamagedFileError, match=r"frame-07\.png is damaged"):
        [*campaign.attachments(0).values()]


def test_frames_of_a_stereo_sensor_are_both_images(tmp_path, scene):
    campaign = simulate(STEREO, tmp_path, CellSettings(scene=scene, raw_frames=True))
    (capture,) = campaign.captures()
    frames = [
        cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        for content in campaign.attachments(0).values()
    ]
    assert np.array_equal(frames[0], capture.image)
    pair = rectify(*campaign.sensor.cameras, campaign.sensor.first_from_camera[1])
    cloud = match_pair(*frames, pair, depth_limits_mm=MATCHED_MM)
    np.testing.assert_array_equal(cloud.points, capture.cloud.points)


@pytest.mark.parametrize(
    ("choice", "difference"),
    [
        ({"clouds": False}, "clouds kept, not without"),
        ({"raw_frames": True}, "no raw frames kept"),
    ],
)
def test_a_campaign_goes_on_with_the_same_choices_only(
    alone, sheet_plan, rings, choice, difference
):
    with pytest.raises(InputError, match=f"simulated with {difference}; go on with that"):
        simulate(sheet_plan, alone, replace(rings, **choice))


def test_a_campaign_of_an_older_version_goes_on(tmp_path, alone, sheet_plan, rings):
    """Of the version that kept all clouds and no frames, and did not say so."""
    shutil.copytree(alone, tmp_path / "old")
    path = tmp_path / "old" / "simulation.json"
    reseal(path, version=1, without=("clouds", "raw_frames"))
    for folder in (tmp_path / "old" / "captures").iterdir():
        reseal(folder / "capture.json", version=1, without=("beside_sha256",))
    shutil.rmtree(tmp_path / "old" / "captures" / "000003")
    campaign = simulate(sheet_plan, tmp_path / "old", rings)
    assert observe_campaign(campaign).frame.equals(observe_campaign(CampaignFolder(alone)).frame)
    with pytest.raises(InputError, match="clouds kept, not without"):
        simulate(sheet_plan, tmp_path / "old", replace(rings, clouds=False))


def reseal(path, version, without):
    document = json.loads(path.read_bytes())
    document = {key: value for key, value in document.items() if key not in (*without, "sha256")}
    document["version"] = version
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    document["sha256"] = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(json.dumps(document), encoding="utf-8")


# -- what cannot be -----------------------------------------------------------------------------


def test_the_folder_of_another_plan_is_refused(
    tmp_path, alone, rings, sheet_plan, one_view, content
):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    for other, difference in (
        (
            replace(sheet_plan, seed=9),
            "another plan, differing in seed; go on with that, or choose",
        ),
        (replace(sheet_plan, lighting="III"), "another plan, differing in lighting"),
        (one_view, "another plan, differing in planes"),
    ):
        with pytest.raises(InputError, match=difference):
            simulate(other, folder, rings)
    with pytest.raises(InputError, match="'sheet' and not 'roof'"):
        simulate(replace(sheet_plan, name="roof"), folder, rings)
    assert content(folder) == content(alone)


def test_whole_frames_and_rings_are_not_mixed(alone, whole, rings, scene, sheet_plan, one_view):
    with pytest.raises(InputError, match="simulated with rings only, not whole frames"):
        simulate(sheet_plan, alone, CellSettings(scene=scene))
    with pytest.raises(InputError, match="simulated with whole frames, not rings only"):
        simulate(one_view, whole.path, rings)


def test_another_scene_is_refused(alone, sheet_scene, sheet_plan):
    settings = CellSettings(rings_only=True, scene=sheet_scene("bare"))
    with pytest.raises(InputError, match="simulated with another scene"):
        simulate(sheet_plan, alone, settings)


def test_captures_that_were_not_simulated_are_refused(tmp_path, whole, rings, sheet_plan):
    recorded = replace(next(whole.captures()), view="recorded")
    with CampaignWriter.open_or_create(
        tmp_path / "cell", name=sheet_plan.name, sensor=whole.sensor, part=whole.part
    ) as writer:
        writer.add(recorded)
    with pytest.raises(InputError, match=r"1 captures and no simulation\.json: they were not"):
        simulate(sheet_plan, tmp_path / "cell", rings)


def test_captures_added_by_hand_are_refused(tmp_path, alone, rings, sheet_plan):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    (folder / "captures" / "000003").rename(folder / "captures" / "000009")
    with pytest.raises(InputError, match="at 330 ms as capture 9, which this plan does not"):
        simulate(sheet_plan, folder, rings)


def test_the_plan_lies_in_the_folder(alone, sheet_plan):
    assert read_plan(alone / "plan.toml") == sheet_plan


def test_an_error_in_a_worker_names_plan_view_and_capture(tmp_path, rings, sheet_plan):
    def block(done: int, _total: int) -> None:
        if done == 0:
            (tmp_path / "captures" / "000005").mkdir()

    message = r"plan 'sheet', view 'middle-x1-y2' at 330 ms: .*000005 was not written: File exists"
    with pytest.raises(FileError, match=message):
        simulate(sheet_plan, tmp_path, replace(rings, workers=2), block)


def test_errors_of_the_plan_come_before_any_folder(tmp_path, rings, sheet_plan):
    folder = tmp_path / "campaign"
    plane = sheet_plan.planes[0]
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
            simulate(plan, folder, rings)
        with pytest.raises(error, match=message):
            simulate_observations(plan, rings)
    assert not folder.exists()


def test_rings_of_a_stereo_sensor_are_refused(tmp_path, rings):
    with pytest.raises(InputError, match="'rc-visard-65' matches whole images"):
        simulate(STEREO, tmp_path, rings)
    with pytest.raises(InputError, match="take whole frames"):
        simulate_observations(STEREO, rings)


def test_a_scene_that_is_not_there_is_named(tmp_path, sheet_plan):
    with pytest.raises(MissingFileError, match=r"no mesh at .*nowhere"):
        simulate(sheet_plan, tmp_path / "c", CellSettings(scene=tmp_path / "nowhere"))


def test_no_worker_is_refused():
    with pytest.raises(InputError, match="at least 1 worker, got 0"):
        CellSettings(workers=0)
