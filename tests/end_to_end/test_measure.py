"""``exposight measure``: a plan carried out by a driver, here a recorded campaign."""

import pytest

from exposight.cell import CampaignFolder
from exposight.observing import observe_campaign, read_observations
from exposight.plans import MeasuringPlan, PoseList, write_plan


@pytest.fixture(scope="module")
def plan(campaign, tmp_path_factory):
    """Every pose and exposure time of the plate's campaign."""
    recorded = CampaignFolder(campaign)
    poses = {capture.view: capture.camera_from_part for capture in recorded.captures()}
    exposures = sorted({key.exposure_ms for key in recorded.keys()})  # noqa: SIM118
    path = tmp_path_factory.mktemp("plan") / "again.toml"
    views = PoseList.from_transforms(
        "recorded", [*poses.values()], exposures_ms=exposures, names=[*poses]
    )
    features = tuple(feature.name for feature in recorded.part.features if feature.name != "far")
    write_plan(
        path, MeasuringPlan(name="again", sensor=recorded.sensor, features=features, poses=[views])
    )
    return path


@pytest.fixture
def replay(campaign):
    return ("--driver", "replay", "--recording", campaign)


def test_a_recording_is_measured_again(plan, replay, campaign, tmp_path, run_json):
    output = tmp_path / "again"
    told = run_json("measure", plan, *replay, "-o", output)
    assert (told["captures"], told["captures_before"], told["views"]) == (18, 0, 3)
    assert told["views_of_feature"]["h01"] == 3
    first = next(CampaignFolder(output).captures())
    assert (first.image == next(CampaignFolder(campaign).captures()).image).all()
    assert run_json("measure", plan, *replay, "-o", output)["captures_before"] == 18


def test_captures_are_observed_at_once(plan, replay, campaign, tmp_path, run_json):
    output = tmp_path / "o.csv"
    told = run_json("measure", plan, *replay, "--observe", "-o", output)
    assert told["visibility"] == [{"visibility": "visible", "rows": 216, "share": 1.0}]
    table = read_observations(output)
    whole = observe_campaign(CampaignFolder(campaign))
    visible = whole.where(whole.names("feature") != "far")
    assert (table.array(["p_norm", "i_avg"]) == visible.array(["p_norm", "i_avg"])).all()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--driver", "replay"), "needs --recording"),
        (("--driver", "simulated", "--recording", "x"), "others do not take it"),
        (("--driver", "genicam"), "needs --cell"),
        ((), "--driver is missing"),
        (("--driver", "simulated", "--observe", "--no-clouds"), "leave out --no-clouds"),
    ],
)
def test_a_wrong_call_ends_with_status_two(words, message, plan, run):
    ended = run("measure", plan, *words)
    assert ended.exit_code == 2
    assert message in ended.stderr
