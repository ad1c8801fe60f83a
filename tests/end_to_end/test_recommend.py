"""``exposight recommend``: which exposures to take of a view, who fails, and wrong calls."""

import polars as pl
import pytest

POSE = ("--robot-pose", "fanuc", "0,0,600,0,0,0")


@pytest.fixture
def recommend(models, campaign, run_json):
    def call(*words, view=("--view", "z600")):
        return run_json("recommend", models, "--campaign", campaign, *view, *words)

    return call


def test_the_first_line_is_the_answer(models, campaign, run):
    words = ("--campaign", campaign, "--view", "z600", "--confidence", 0.6)
    ended = run("recommend", models, *words)
    assert ended.exit_code == 0, ended.stderr
    first = ended.stdout.splitlines()[0]
    assert first.startswith("take ")
    assert "of 12 features will reach 0.75 with a chance of 60 % or more" in first
    assert "far: not seen" in " ".join(ended.stdout.split())


def test_exposures_are_the_sensors_settings_in_its_unit(recommend, tmp_path):
    limits = tmp_path / "limits.toml"
    limits.write_text(
        '[mine]\nmin_ms = 1.0\nmax_ms = 50.0\nincrement_ms = 0.5\nunit = "us"\n', "utf-8"
    )
    told = recommend("--confidence", 0.6, "--limits", limits)
    assert told["limits"] == "mine"
    assert any("limits are of mine" in note for note in told["notes"])
    for exposure in told["exposures"]:
        assert exposure["exposure_ms"] % 0.25 == pytest.approx(0.0)
        assert (exposure["set_value"], exposure["set_unit"]) == (
            1000 * exposure["exposure_ms"], "us"
        )  # fmt: skip
    assert told["exposures_ms"] == [each["exposure_ms"] for each in told["exposures"]]
    assert {row["feature"] for row in told["features"]} == {f"h{n:02d}" for n in range(1, 13)}
    assert told["hidden"] == {"far": "out of frame"}


def test_flicker_and_the_number_per_view_are_kept_to(recommend):
    told = recommend("--confidence", 0.6, "--flicker", 50, "--most", 1)
    assert len(told["exposures_ms"]) <= 1
    assert all(t % 10 == pytest.approx(0.0) for t in told["exposures_ms"])


def test_time_counts_frames_and_overhead(recommend):
    told = recommend("--confidence", 0.6, "--frames", 12, "--overhead", 500, "--prefer", "time")
    wanted = sum(12 * t + 500 for t in told["exposures_ms"])
    assert told["time_ms"] == pytest.approx(wanted)


def test_it_is_written_and_drawn(recommend, tmp_path):
    path, picture = tmp_path / "r.csv", tmp_path / "r.png"
    told = recommend("-o", path, "--picture", picture)
    assert pl.read_csv(path).height == 12
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert {file["kind"] for file in told["files"]} == {"recommendation", "picture"}


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (("--confidence", 1), 1, "confidence is a chance above 0 and below 1"),
        (("--confidence", 0), 1, "confidence is a chance above 0 and below 1"),
        (("--need", 0), 2, "Must be > 0"),
        (("--most", 0), 2, "Must be > 0"),
        (("--limits", "zivid"), 1, "did you mean 'zivid-2'"),
        (("--limits", "missing.toml"), 1, "no file of exposure limits at missing.toml"),
        (("--flicker", 1), 1, "mains have 50 or 60 Hz, got 1"),
        (("--picture", "a.pdf"), 2, "writes PNG or SVG"),
        (("--prefer", "both"), 2, '"margin", "time"'),
        (("--trial", "missing.csv"), 1, "no such observation table"),
    ],
)
def test_a_wrong_wish_is_named(words, status, message, models, campaign, run):
    view = ("--campaign", campaign, "--view", "z600")
    ended = run("recommend", models, *view, *words)
    assert ended.exit_code == status, ended.stdout
    assert message in ended.stderr


def test_limits_that_allow_nothing_are_an_error(models, campaign, tmp_path, run):
    limits = tmp_path / "limits.toml"
    view = ("--campaign", campaign, "--view", "z600")
    for low, high, fact in (
        (0.5, 1.0, "limits leave nothing"),
        (5000.0, 9000.0, "allow 5000 ms, which 'small' cannot take: 0.5–50 ms"),
    ):
        text = f"[dark]\nmin_ms = {low}\nmax_ms = {high}\nincrement_ms = 0.5\n"
        limits.write_text(text, "utf-8")
        ended = run("recommend", models, *view, "--limits", limits)
        assert ended.exit_code == 1
        assert fact in ended.stderr


def test_a_view_that_sees_nothing_is_an_error(models, campaign, run):
    away = ("--campaign", campaign, "--robot-pose", "fanuc", "0,0,-600,0,0,0")
    ended = run("recommend", models, *away)
    assert ended.exit_code == 1
    assert "no feature is visible from this pose: behind the camera" in ended.stderr


def test_wrong_features_are_errors(models, campaign, tmp_path, run):
    features = (campaign / "features.csv").read_text("utf-8").splitlines()
    for name, lines, message in (
        ("empty", features[:1], "no feature"),
        ("twice", [*features, features[1]], "twice"),
    ):
        path = tmp_path / f"{name}.csv"
        path.write_text("\n".join(lines) + "\n", "utf-8")
        words = ("--sensor", campaign / "sensor.json", "--features", path, *POSE)
        ended = run("recommend", models, *words)
        assert ended.exit_code == 1
        assert message in ended.stderr


def test_another_sensor_than_the_models_is_an_error(models, campaign, run):
    words = ("--sensor", "comet-pro-ae", "--features", campaign / "features.csv", *POSE)
    ended = run("recommend", models, *words)
    assert ended.exit_code == 1
    assert (
        "the view is of sensor 'ZEISS COMET Pro AE', the models were trained on 'small'"
        in ended.stderr
    )
