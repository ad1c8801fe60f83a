"""A recorded campaign as a driver."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import CampaignFolder
from exposight.drivers import ReplayDriver
from exposight.errors import InputError
from exposight.geometry import RigidTransform
from exposight.measuring import measure, measure_observations, recorded_driver
from exposight.observing import observe_campaign


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
