"""``exposight propose``: which capture to take next, and the loop of measuring and learning."""

import polars as pl
import pytest

from exposight.models import load_model
from exposight.observing import read_observations
from exposight.plans import read_plan

SUFFIX = ".exposight-model"

PLAN = """
format = "exposight measuring plan"
version = 3
name = "plate"
sensor = "{folder}/sensor.json"
features = ["h01", "h02", "h06", "h11", "h12"]

[[poses]]
name = "tilted"
notation = "fanuc"
frame = "camera_from_part"
rows = [[0, 0, 600, 20, 0, 0], [0, 0, 600, 0, 20, 0], [30, 20, 520, -20, 0, 0]]
names = ["down", "right", "up"]
exposures_ms = [5]
"""

SHEET = """
format = "exposight measuring plan"
version = 3
name = "{name}"
sensor = "comet-pro-ae"
features = ["h0", "h1"]
reference = "h0"

[[planes]]
name = "{name}"
z_tcp_mm = -5
x_mm = {x_mm}
y_mm = [-30, 30]
exposures_ms = [60]

[simulated]
scene = "{scene}"
"""


@pytest.fixture(scope="module")
def default_models(campaign, observations, tmp_path_factory, run_json):
    folder = tmp_path_factory.mktemp("default")
    run_json("train", observations, "--sensor", campaign / "sensor.json", "-o", folder)
    return folder


@pytest.fixture(scope="module")
def plan(campaign, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plate.toml"
    path.write_text(PLAN.format(folder=campaign), encoding="utf-8")
    return path


@pytest.fixture
def words(default_models, campaign, plan):
    """What proposes views of the plan."""
    features = ("--features", campaign / "features.csv")
    return ("propose", default_models / f"quality{SUFFIX}", "--views", plan, *features)


def test_the_answer_comes_first_and_is_a_setting_of_the_sensor(words, run, run_json):
    told = run_json(*words)
    (capture,) = told["captures"]
    assert capture == {key: told["best_views"][0][key] for key in capture}
    assert told["views"] == len(told["ranking"]) == 3
    assert capture["error_after"] < 0.9 * capture["error_before"]
    assert round(capture["rings"]) == 5
    assert capture["exposure_ms"] in told["exposures_ms"]
    assert all(time_ms % 0.5 == 0.0 for time_ms in told["exposures_ms"])
    shown = run(*words).stdout
    first = shown.splitlines()[0]
    assert first.startswith(f"capture view {capture['view']} at {capture['exposure_ms']:g} ms: it ")
    assert "measures 5 rings and takes the uncertainty of brightness from" in first
    assert "15 rings; the least known, h" in " ".join(shown.split())


def test_captures_follow_each_other(words, tmp_path, run, run_json):
    path = tmp_path / "next.toml"
    told = run_json(*words, "--count", 2, "--exposures", "1:40", "--next-plan", path)
    one, two = told["sequence"]
    assert (one["step"], two["step"]) == (1, 2)
    assert one["error_after"] == pytest.approx(two["error_before"])
    assert two["error_after"] < two["error_before"]
    assert one["view"] != two["view"]
    assert all(1.0 <= time_ms <= 40.0 for time_ms in told["exposures_ms"])
    group = read_plan(path).poses[0]
    assert group.name == "tilted"
    assert set(zip(group.names, group.exposures_each_ms, strict=True)) == {
        (step["view"], (step["exposure_ms"],)) for step in (one, two)
    }
    ended = run(*words, "--count", 9)
    assert ended.stdout.startswith("capture ")
    assert "note: after" in ended.stdout


def test_views_of_a_campaign_and_of_a_table_are_proposed(
    default_models, campaign, observations, run_json
):
    by_campaign, by_table = (
        run_json("propose", default_models, "--views", each) for each in (campaign, observations)
    )
    assert by_campaign["ranking"] == by_table["ranking"]
    assert {line["view"] for line in by_table["ranking"]} == {"z560", "z600", "z640"}


def test_a_simulated_sheet_is_learnt_capture_by_capture(scene, tmp_path, run, run_json):
    first, whole = (tmp_path / f"{name}.toml" for name in ("first", "whole"))
    first.write_text(SHEET.format(name="first", x_mm=[0], scene=scene), "utf-8")
    whole.write_text(SHEET.format(name="whole", x_mm=[-60, 60], scene=scene), "utf-8")
    simulate = ("--rings-only", "--observe", "--workers", 1)
    run_json("simulate", first, *simulate, "-o", tmp_path / "first.csv")
    run_json("train", tmp_path / "first.csv", "-o", tmp_path)
    quality = tmp_path / f"quality{SUFFIX}"
    next_plan, taken, wiser = (tmp_path / name for name in ("n.toml", "n.csv", f"w{SUFFIX}"))
    told = run_json("propose", quality, "--views", whole, "--next-plan", next_plan)
    (proposed,) = told["captures"]
    run_json("simulate", next_plan, *simulate, "-o", taken)
    frame = read_observations(taken).measured().frame
    assert set(frame["view"]) == {proposed["view"]}
    assert frame.height == round(proposed["rings"]) == 2
    assert frame["stack_clipped_share"].max() < 0.01
    assert frame["i_mean"].min() > 20.0

    words = ("propose", quality, "--views", whole, "--captured", taken)
    told = run_json(*words, "-o", wiser)
    assert told["learnt"] == 1
    assert told["views"] == 3
    assert told["targets"]["error"] < proposed["error_before"]
    assert load_model(wiser).radiance.n_observations == 6
    assert run_json(*words, "--again")["views"] == 4
    shown = " ".join(run(*words).stdout.split())
    assert "1 capture, 2 measured rows, in" in shown
    whole.write_text(whole.read_text("utf-8").replace('"h1"', '"h1", "h9"'), "utf-8")
    assert "by --features" in run(*words).stderr


def test_it_is_said_when_nothing_is_left_to_learn(
    default_models, campaign, observations, tmp_path, run, run_json
):
    frame = read_observations(observations).frame
    path = tmp_path / "often.csv"
    times = [(name, pl.col("exposure_ms")) for name in "abcdefgh"]
    pl.concat([frame.with_columns(view=pl.col("view") + name) for name, _ in times]).write_csv(path)
    words = ("propose", default_models, "--captured", path, "--views", campaign)
    told = run_json(*words, "--next-plan", tmp_path / "none.toml")
    assert told["captures"] == told["files"] == []
    assert not (tmp_path / "none.toml").exists()
    assert run(*words).stdout.startswith("nothing more to learn from these views: every target")


@pytest.mark.parametrize(
    ("more", "status", "message"),
    [
        (("--exposures", "5:x"), 2, "FIRST:LAST"),
        (("--exposures", "40:5"), 2, "FIRST:LAST"),
        (("--exposures", 5, 900), 1, "takes exposure times from 0.5 to 50 ms, got 900 ms"),
        (("-o", "m.toml"), 2, "give that, too"),
        (("--next-plan", "next.csv"), 2, "writes TOML"),
        (("--views", "smal"), 1, "did you mean 'small'?"),
        (("--views", "small"), 1, "no feature 'f1'"),
        (("--count", 0), 2, "Must be > 0"),
    ],
)
def test_what_cannot_be_proposed(more, status, message, words, run):
    if more[0] == "--views":
        words = (*words[:2], *words[4:])
    ended = run(*words, *more)
    assert ended.exit_code == status
    assert message in ended.stderr


def test_what_does_not_fit_is_refused(
    words, models, default_models, campaign, observations, plan, tmp_path, run
):
    def refused(*call):
        ended = run(*call)
        assert ended.exit_code in (1, 2)
        return ended.stderr

    of_paper = models / f"q_k4{SUFFIX}"
    assert "need the default quality model" in refused("propose", of_paper, *words[2:])
    assert "was trained on it" in refused(*words, "--captured", observations)
    behind = tmp_path / "behind.toml"
    behind.write_text(plan.read_text("utf-8").replace("600, 20, 0, 0", "600, 180, 0, 0"), "utf-8")
    assert "sees none of its features" in refused(*words[:3], behind, *words[4:])
    assert "does not tell" in refused(
        "propose", default_models, "--views", observations, "--next-plan", tmp_path / "n.toml"
    )
    frame = read_observations(observations).frame
    again, other = tmp_path / "again.csv", tmp_path / "other.csv"
    frame.filter(pl.col("exposure_ms") == 3.0).write_csv(again)
    captured = ("propose", default_models, "--views", campaign, "--captured", again)
    assert "nothing is left to propose: 3 views" in refused(*captured)
    shown = " ".join(run(*captured, "--again").stdout.split())
    assert "quality has learnt from 36 of the 36 rings in --captured before" in shown
    frame.with_columns(sensor=pl.lit("another")).write_csv(other)
    assert "another sensor: 'another'" in refused(*words, "--captured", other)
    behind.write_text(plan.read_text("utf-8").replace(f"{campaign}/sensor.json", "comet-pro-ae"))
    assert "is of sensor 'ZEISS COMET Pro AE', quality was trained on 'small'" in refused(
        *words[:3], behind, *words[4:]
    )
