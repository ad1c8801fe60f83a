from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import CaptureSource, MemoryCampaign
from exposight.errors import ImageError, InputError


@pytest.fixture
def campaign(sensor, part, make_capture) -> MemoryCampaign:
    captures = [make_capture(20.0), make_capture(10.0), make_capture(10.0, view="v2")]
    return MemoryCampaign(name="door", sensor=sensor, part=part, captures=captures)


def test_captures_come_in_the_order_they_were_given_every_time(campaign):
    expected = [("v1", 20.0), ("v1", 10.0), ("v2", 10.0)]
    assert [capture.key for capture in campaign.captures()] == expected
    assert [capture.key for capture in campaign.captures()] == expected
    assert len(campaign) == 3


def test_a_campaign_in_memory_is_a_campaign(campaign):
    def name_of(some: CaptureSource) -> str:
        return some.name

    assert name_of(campaign) == "door"


def test_the_same_view_and_exposure_twice_is_refused(sensor, part, make_capture):
    with pytest.raises(InputError, match="'door' already has a capture of view 'v1' at 10 ms"):
        MemoryCampaign(
            name="door", sensor=sensor, part=part, captures=[make_capture(), make_capture()]
        )


def test_a_capture_of_another_sensor_is_refused(sensor, part, make_capture):
    wrong = replace(make_capture(), image=np.zeros((5, 5), np.uint8))
    with pytest.raises(ImageError, match="sensor 'small' takes images of 12 rows"):
        MemoryCampaign(name="door", sensor=sensor, part=part, captures=[wrong])
