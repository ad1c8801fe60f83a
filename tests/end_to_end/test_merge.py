"""``exposight merge``: a campaign of merged captures, and what that gained."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import CampaignWriter, Cloud
from exposight.imaging import merge_record
from exposight.observing import open_campaign


def test_a_campaigns_views_are_merged_each(campaign, tmp_path, run_json) -> None:
    folder = tmp_path / "merged"
    result = run_json("merge", campaign, "-o", folder)
    assert result["views"] == 3
    merged = open_campaign(folder)
    assert len(merged) == 3
    for capture in merged.captures():
        singles = [c for c in open_campaign(campaign).captures() if c.view == capture.view]
        valid = np.any([single.cloud.valid for single in singles], axis=0)
        assert np.array_equal(capture.cloud.valid, valid)
        record = merge_record(capture)
        assert record.criterion == "grey level"
        assert len(record.exposures_ms) == 6
    # The plate is evenly bright: one exposure serves all its holes.
    assert [row["single"] for row in result["gain"]] == [row["merged"] for row in result["gain"]]
    rows = result["features"]
    assert len(rows) == 36
    assert all(row["merged"] >= row["single"] - 0.02 for row in rows)


def test_views_and_exposures_can_be_chosen(campaign, tmp_path, run_json, run) -> None:
    words = ("--view", "z600", "--exposures", 1, 40)
    result = run_json("merge", campaign, "-o", tmp_path / "m", *words)
    assert result["merged"][0]["exposures_ms"] == [1.0, 40.0]
    shown = run("merge", campaign, "-o", tmp_path / "n", *words)
    assert "merging gains nothing" in shown.stdout


@pytest.mark.parametrize(
    ("words", "fact"),
    [
        (("--view", "z601"), "no such capture of a view 'z601'"),
        (("--exposures", 3), "nothing to merge"),
        (("--exposures", 4, 5), "at 4, 5 ms"),
    ],
)
def test_what_cannot_be_merged(words, fact, campaign, tmp_path, run) -> None:
    ended = run("merge", campaign, "-o", tmp_path / "m", *words)
    assert ended.exit_code == 1
    assert fact in ended.stderr
    assert not (tmp_path / "m").exists()


def test_clouds_of_rings_alone_are_told_with_the_option_that_made_them(
    campaign, tmp_path, run
) -> None:
    recorded, folder = open_campaign(campaign), tmp_path / "rings"
    with CampaignWriter.open_or_create(
        folder, name="rings", sensor=recorded.sensor, part=recorded.part
    ) as writer:
        for number in (1, 2):
            capture = recorded.capture(number)
            writer.add(replace(capture, cloud=Cloud(points=capture.cloud.valid_points)))
    ended = run("merge", folder, "-o", tmp_path / "m")
    assert ended.exit_code == 1
    assert "--rings-only" in ended.stderr
    assert not (tmp_path / "m").exists()


def test_a_folder_that_is_there_and_models_that_promise_nothing(
    campaign, models, tmp_path, run
) -> None:
    ended = run("merge", campaign, "-o", tmp_path)
    assert ended.exit_code == 1
    assert "is there already" in ended.stderr
    ended = run("merge", campaign, "-o", tmp_path / "m", "--models", models)
    assert ended.exit_code == 1
    assert "only the default models" in ended.stderr


def test_what_does_not_agree_in_a_merged_capture_is_told(campaign, tmp_path, run_json) -> None:
    recorded, folder = open_campaign(campaign), tmp_path / "dark"
    with CampaignWriter.open_or_create(
        folder, name="dark", sensor=recorded.sensor, part=recorded.part
    ) as writer:
        for capture in recorded.captures():
            # Points everywhere, and hardly any light.
            writer.add(replace(capture, image=np.zeros_like(capture.image)))
    told = run_json("merge", folder, "-o", tmp_path / "m")
    assert "points-in-the-dark" in [each["check"] for each in told["contradictions"]]
