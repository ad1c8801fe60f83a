"""A recorded campaign as a driver."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import CampaignFolder
from exposight.drivers import ReplayDriver
from exposight.errors import InputError, SensorError
from exposight.geometry import RigidTransform
from exposight.measuring import measure, measure_observations, recorded_driver
from exposight.observing import observe_campaign
from exposight.plans import write_plan


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_campaign_is_measured_again_from_its_recording(tmp_path, alone, sheet_plan, workers):
    replay = ReplayDriver(alone)
    campaign = measure(sheet_plan, replay, tmp_path, workers=workers)
    assert observe_campaign(campaign).frame.equals(observe_campaign(CampaignFolder(alone)).frame)
    assert recorded_driver(tmp_path) == "replay"


def test_some_of_its_exposures_give_their_share_of_the_table(alone, sheet_plan):
    plan = replace(sheet_plan, planes=(replace(sheet_plan.planes[0], exposures_ms=(330.0,)),))
    table = measure_observations(plan, ReplayDriver(alone)).frame
    whole = observe_campaign(CampaignFolder(alone)).frame
    assert table.equals(whole.filter(whole["exposure_ms"] == 330.0))


def test_the_capture_gets_the_name_asked_for_and_keeps_the_recorded_pose(alone):
    replay, recorded = ReplayDriver(alone), next(CampaignFolder(alone).captures())
    capture = replay.capture(30.0, recorded.camera_from_part, view="again")
    assert capture.view == "again"
    assert capture.camera_from_part == recorded.camera_from_part
    assert np.array_equal(capture.image, recorded.image)
    assert capture.brightness_source == "stripes-mean"
    assert np.array_equal(capture.stack.modulation, recorded.stack.modulation)


def test_what_was_not_recorded_is_named(alone):
    replay, recorded = ReplayDriver(alone), next(CampaignFolder(alone).captures())
    with pytest.raises(InputError, match=r"view 'middle-x1-y1' at 30, 330 ms, not at 50 ms"):
        replay.capture(50.0, recorded.camera_from_part, view="v")
    away = RigidTransform(translation_mm=np.array([0.0, 0.0, 25.0])) @ recorded.camera_from_part
    with pytest.raises(InputError, match=r"nearest view, 'middle-x1-y1', .* 25\.0 mm elsewhere"):
        replay.capture(30.0, away, view="v")


def at(plan, *exposures_ms):
    return replace(plan, planes=(replace(plan.planes[0], exposures_ms=exposures_ms),))


def test_the_nearest_exposure_time_within_two_percent_is_given(alone):
    replay, recorded = ReplayDriver(alone), next(CampaignFolder(alone).captures())
    assert replay.capture(324.0, recorded.camera_from_part, view="v").exposure_ms == 330.0
    with pytest.raises(InputError, match=r"30, 330 ms, not at 322 ms or within 2 %"):
        replay.capture(322.0, recorded.camera_from_part, view="v")


def test_more_may_be_allowed_and_the_measurement_takes_it(tmp_path, alone, one_view):
    plan = at(one_view, 33.0, 320.0)
    with pytest.raises(InputError, match="not at 33 ms or within 2 %"):
        measure(plan, ReplayDriver(alone), tmp_path / "narrow")
    for _ in range(2):  # again: all is there
        campaign = measure(plan, ReplayDriver(alone, within=0.1), tmp_path / "wide")
    assert [capture.exposure_ms for capture in campaign.descriptions()] == [30.0, 330.0]


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_recorded_capture_is_not_given_for_two_planned_ones(
    tmp_path, alone, one_view, interrupted
):
    plan, replay = at(one_view, 29.0, 33.0), ReplayDriver(alone, within=0.2)
    for _ in range(1 + interrupted):
        with pytest.raises(SensorError, match="set to 33 ms and took 30 ms, which it had taken"):
            measure(plan, replay, tmp_path / "door")
    assert len(CampaignFolder(tmp_path / "door")) == 1
    with pytest.raises(SensorError, match="which it had taken before"):
        measure_observations(plan, replay)


def test_a_share_that_is_none_is_refused(alone):
    with pytest.raises(InputError, match="from 0 to 1, got 10"):
        ReplayDriver(alone, within=10.0)


def test_the_command_says_by_how_much(tmp_path, alone, one_view, run):
    write_plan(tmp_path / "plan.toml", at(one_view, 33.0))
    given = ("measure", tmp_path / "plan.toml", "--driver")
    replay = (*given, "replay", "--recording", alone, "-o", tmp_path / "again")
    assert "not at 33 ms or within 5 %" in " ".join(run(*replay, "--within", 5).stderr.split())
    assert run(*replay, "--within", 10).exit_code == 0
    assert run(*given, "simulated", "--within", 10).exit_code != 0
