"""A campaign as scripts use it."""

import pytest

from exposight.cell import CampaignWriter, Part
from exposight.errors import InputError, MissingFileError
from exposight.observing import Visibility, observe_campaign, open_campaign


@pytest.fixture
def folder(tmp_path, sensor, facing, make_capture, hole):
    plate = {"name": "<c>", "sensor": sensor, "part": Part(name="plate", features=(hole(),))}
    with CampaignWriter.open_or_create(tmp_path / "c", **plate) as writer:
        for exposure_ms in (5.0, 10.0):
            writer.add(make_capture(sensor, facing, exposure_ms=exposure_ms))
    return tmp_path / "c"


def test_a_campaign_is_opened_and_observed(folder):
    campaign = open_campaign(str(folder))
    steps = []
    table = campaign.observe(progress=lambda *step: steps.append(step))
    assert table.frame.equals(observe_campaign(campaign).frame)
    assert steps == [("observing", 1, 2), ("observing", 2, 2)]
    assert (campaign.name, len(campaign), campaign.part.name) == ("<c>", 2, "plate")


def test_a_view_tells_what_a_pose_sees(folder, facing):
    view = open_campaign(folder).view(facing)
    with pytest.raises(InputError, match=r"expected a pose, camera_from_part .* got 'near'"):
        open_campaign(folder).view("near")
    assert [each.visibility for each in view.visible] == [Visibility.VISIBLE] * len(view.visible)
    assert "visible" in view._repr_html_()


def test_a_notebook_shows_the_first_image_and_escapes_names(folder):
    shown = open_campaign(folder)._repr_html_()
    assert "&lt;c&gt;" in shown
    assert "data:image/png;base64," in shown


def test_a_campaign_without_captures_shows_itself(sensor, hole, tmp_path):
    part = Part(name="p", features=(hole(),))
    CampaignWriter.open_or_create(tmp_path, name="c", sensor=sensor, part=part).close()
    assert "0 captures" in open_campaign(tmp_path)._repr_html_()


def test_a_folder_that_is_no_campaign(tmp_path):
    with pytest.raises(MissingFileError, match="no campaign"):
        open_campaign(tmp_path)
