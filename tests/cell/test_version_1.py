"""A campaign that earlier versions wrote; its capture 0 is of version 1, the others of 2."""

from pathlib import Path

import numpy as np

from exposight.cell import CampaignFolder, CampaignWriter

FOLDER = Path(__file__).with_name("version-1-campaign")


def test_it_opens():
    campaign = CampaignFolder(FOLDER)
    assert (campaign.name, campaign.part.name) == ("version 1", "Blech")
    assert campaign.keys() == (("v1", 10.5), ("v1", 20), ("v2", 30))
    assert campaign.sensor.camera.distortion == (0.1, -0.05, 0.001, 0.002, 0.01)
    assert [feature.kind for feature in campaign.part.features] == ["hole", "surface_point", "slot"]
    assert campaign.part.features[2].length_mm == 20


def test_its_captures_are_what_they_were():
    captures = list(CampaignFolder(FOLDER).captures())
    assert [int(capture.image.sum()) for capture in captures] == [99975, 1583391, 98825]
    assert [capture.bit_depth for capture in captures] == [8, 12, 8]
    assert [capture.cloud and capture.cloud.n_valid for capture in captures] == [64, 66, None]
    assert [dict(capture.attachments) for capture in captures] == [{}, {}, {"a.txt": b"A"}]
    assert {(capture.stack, capture.brightness_source) for capture in captures} == {
        (None, "stripe")
    }
    assert captures[0].notes == "Ärger & Freude"
    np.testing.assert_allclose(captures[0].camera_from_part.translation_mm, [1, 2, 600])


def test_the_same_files_are_written_today(tmp_path):
    """Clouds, sensors and features have not changed; captures say more from version 3 on."""
    campaign = CampaignFolder(FOLDER)
    with CampaignWriter.open_or_create(
        tmp_path, name=campaign.name, sensor=campaign.sensor, part=campaign.part
    ) as writer:
        for capture in campaign.captures():
            writer.add(capture)
    for name in ("captures/000000/cloud.npz", "captures/000001/cloud.npz"):
        assert (tmp_path / name).read_bytes() == (FOLDER / name).read_bytes()
    old, new = (path / "captures" / "000001" / "capture.json" for path in (FOLDER, tmp_path))
    assert new.read_text().splitlines()[3:9] == old.read_text().splitlines()[3:9]
    old, new = (path / "features.csv" for path in (FOLDER, tmp_path))
    assert new.read_text().splitlines()[0] == old.read_text().splitlines()[0]
    for capture in CampaignFolder(tmp_path).captures():
        assert capture.stack is None
    assert (tmp_path / "sensor.json").read_text().splitlines()[:24] == (
        (FOLDER / "sensor.json").read_text().splitlines()[:24]
    )
