"""Forecast, recommend and plan answer what the library returns for the same input."""

import json

import numpy as np
import pytest

from exposight.geometry import RigidTransform
from exposight.observing import open_campaign
from exposight.planning import ExposureLimits, SensorModels, parse_exposure_plan

ABOUT = {"models": "models", "campaign": "campaign"}
POSE = RigidTransform.from_fanuc_wpr((0.0, 0.0, 600.0), 3.0, -2.0, 1.0)
MATRIX = POSE.to_matrix().tolist()


def poses(count):
    rng = np.random.default_rng(5)
    for _ in range(count):
        place = rng.uniform((-40.0, -30.0, 540.0), (40.0, 30.0, 660.0))
        yield RigidTransform.from_fanuc_wpr(place, *rng.uniform(-9.0, 9.0, 3))


@pytest.fixture(scope="module")
def campaign(original):
    return open_campaign(original / "campaign")


@pytest.fixture(scope="module")
def models(original):
    return SensorModels.load(original / "models")


def test_recommendations_are_the_librarys_to_the_last_bit(client, campaign, models):
    for pose in poses(20):
        body = {**ABOUT, "camera_from_part": pose.to_matrix().tolist()}
        got = client.post("/v1/recommend", json=body).json()
        # the pose as JSON has it
        said = RigidTransform.from_matrix(json.loads(json.dumps(body))["camera_from_part"])
        expected = models.recommend(campaign.view(said), ExposureLimits.of(campaign.sensor))
        assert tuple(got["exposures_ms"]) == expected.exposures_ms
        assert got["expected"] == expected.expected
        for row, outlook in zip(got["features"], expected.features, strict=True):
            window = row["window_ms"]
            assert {**row, "window_ms": window and tuple(window)} == vars(outlook)
        assert got["hidden"] == dict(expected.hidden)


def test_forecasts_are_the_librarys_to_the_last_bit(client, campaign, models):
    for pose in poses(20):
        matrix = pose.to_matrix().tolist()
        got = client.post("/v1/forecast", json={**ABOUT, "camera_from_part": matrix}).json()
        expected = models.forecast(campaign.view(RigidTransform.from_matrix(matrix)))
        assert got["exposures_ms"] == list(expected.exposures_ms)
        assert got["best_exposure_ms"] == expected.best_exposure_ms()
        for name in ("p_norm", "p_norm_low", "p_norm_high", "chance", "brightness"):
            rows = [each[name] for each in got["features"]]
            np.testing.assert_array_equal(rows, getattr(expected, name))


def test_a_view_of_the_campaign_in_place_of_a_pose(client, campaign, models):
    got = client.post("/v1/forecast", json={**ABOUT, "view": "v2", "exposures_ms": [4, 8.0]})
    (pose,) = {d.camera_from_part for d in campaign.descriptions() if d.view == "v2"}
    expected = models.forecast(campaign.view(pose, "v2"), (4.0, 8.0))
    assert [each["p_norm"] for each in got.json()["features"]] == expected.p_norm.tolist()


def test_robot_coordinates_and_a_matrix_are_the_same(client):
    robot = {"notation": "fanuc", "text": "0,0,600,3,-2,1"}
    one = client.post("/v1/recommend", json={**ABOUT, "robot_pose": robot}).json()
    other = client.post("/v1/recommend", json={**ABOUT, "camera_from_part": MATRIX}).json()
    assert one["exposures_ms"] == other["exposures_ms"]
    for a, b in zip(one["features"], other["features"], strict=True):
        assert a["chance"] == pytest.approx(b["chance"], abs=1e-9)


def test_features_and_sensor_in_place_of_a_campaign(client, models, original):
    body = {
        "models": "models",
        "features": "features.csv",
        "sensor": "sensor.json",
        "camera_from_part": MATRIX,
    }
    got = client.post("/v1/recommend", json=body)
    assert got.status_code == 200, got.text
    same = client.post("/v1/recommend", json={**ABOUT, "camera_from_part": MATRIX}).json()
    assert got.json()["exposures_ms"] == same["exposures_ms"]


def test_settings_are_in_the_unit_asked_for_and_within_the_limits_given(client):
    body = {**ABOUT, "camera_from_part": MATRIX, "unit": "us", "most_per_view": 1}
    limits = {"min_ms": 2.0, "max_ms": 40.0, "increment_ms": 2.0}
    got = client.post("/v1/recommend", json={**body, "limits": limits}).json()
    (exposure,) = got["exposures"]
    assert exposure["set_value"] == 1000.0 * exposure["exposure_ms"]
    assert exposure["set_unit"] == "us"
    assert exposure["exposure_ms"] % 2.0 == 0.0
    got = client.post("/v1/forecast", json={**ABOUT, "view": "v1", "unit": "s"}).json()
    assert got["set_values"][0] == pytest.approx(got["exposures_ms"][0] / 1000.0, rel=1e-9)


def test_a_plan_is_a_document_that_is_saved_once(served, asking, models):
    with asking(served) as client:
        views = [{"name": "front", "camera_from_part": MATRIX}]
        body = {**ABOUT, "views": views, "save_as": "plans/new.json", "time_limit_s": 5}
        got = client.post("/v1/plan", json=body)
        assert got.status_code == 200, got.text
        planned = parse_exposure_plan(json.dumps(got.json()["plan"]), "answer")
        written = (served / "plans/new.json").read_text()
        assert parse_exposure_plan(written, "file") == planned
        assert [view.name for view in planned.views] == ["front"]
        assert client.post("/v1/plan", json=body).status_code == 409
        assert (served / "plans/new.json").read_text() == written
        assert "plans/new.json" in client.get("/v1/plans").json()["exposure_plans"]


def test_the_models_of_a_folder_that_changes_are_read_again(served, asking, models):
    body = {**ABOUT, "models": "other", "view": "v1"}
    with asking(served) as client:
        assert client.post("/v1/recommend", json=body).status_code == 404
        models.save(served / "other")
        assert client.post("/v1/recommend", json=body).status_code == 200
        for file in (served / "other").iterdir():
            file.write_bytes(b"no model")
        assert client.post("/v1/recommend", json=body).status_code == 422


def test_no_feature_in_view_is_said_with_the_reason(client):
    away = RigidTransform(translation_mm=np.array([0.0, 0.0, -600.0])).to_matrix().tolist()
    got = client.post("/v1/recommend", json={**ABOUT, "camera_from_part": away})
    assert got.status_code == 422
    assert "no feature is visible" in got.json()["error"]


@pytest.mark.parametrize(
    ("change", "status", "words"),
    [
        ({"models": "model"}, 404, "did you mean 'models'"),
        ({"campaign": "nothing"}, 404, "nothing"),
        ({"view": "v9"}, 404, "no view 'v9'"),
        ({"veiw": "v1"}, 422, "did you mean 'view'"),
        ({"confidence": 1.5}, 422, "confidence"),
        ({"confidence": "0.9"}, 422, "confidence"),
        ({"camera_from_part": MATRIX}, 422, "in place of a pose"),
        ({"profile": "zivid"}, 422, "did you mean"),
        ({"at_most": 0.5}, 422, "at_least"),
        ({"features": "features.csv"}, 422, "give either"),
        ({"target": "nothing"}, 422, "nothing"),
    ],
)
def test_what_cannot_be_is_refused_with_the_fact(client, change, status, words):
    got = client.post("/v1/recommend", json={**ABOUT, "view": "v1", **change})
    assert got.status_code == status, got.text
    assert words in got.json()["error"]
    assert set(got.json()) == {"error", "kind", "facts"}


@pytest.mark.parametrize(
    "rows",
    [
        [[1, 0], [0, 1], [0, 0]],
        [[2.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 600], [0, 0, 0, 1]],
        [[1, 0, 0, 1e308], [0, 1, 0, 0], [0, 0, 1, 600], [0, 0, 0, 1]],
        [[1, 0, 0, 10**299], [0, 1, 0, 0], [0, 0, 1, 600], [0, 0, 0, 1]],
        [[], [], []],
    ],
)
def test_a_matrix_that_is_no_pose(client, rows):
    for path in ("/v1/recommend", "/v1/forecast"):
        got = client.post(path, json={**ABOUT, "camera_from_part": rows})
        assert got.status_code == 422, got.text


@pytest.mark.parametrize(
    "name",
    [
        *("campaign.json", "plans/Sensor.json", "part.json", ".hidden.json", "a/.b/x.json"),
        *("loops/q.json", "runs/r9/request.json", "LOOPS/q.json", "plans/new.txt"),
        *("campaign/x.json", "campaign/captures/000000/plan.json", "models/plan.json"),
    ],
)
def test_a_plan_is_not_written_where_it_would_hide_or_change_something(served, asking, name):
    before = set(served.rglob("*"))
    with asking(served) as client:
        got = client.post("/v1/plan", json={**ABOUT, "save_as": name})
        assert got.status_code == 422, got.text
        assert client.get("/v1/health").json()["serves"]["campaigns"] == 1
    assert set(served.rglob("*")) == before


def test_a_plan_that_fails_leaves_no_folder(served, asking):
    with asking(served) as client:
        body = {**ABOUT, "models": "nothing", "save_as": "zz/z.json"}
        assert client.post("/v1/plan", json=body).status_code == 404
    assert not (served / "zz").exists()


@pytest.mark.parametrize(
    ("path", "body", "words", "keys"),
    [
        (
            "/v1/recommend",
            {"models": "models", "robot_pose": {"notation": "fanuk", "text": "1"}},
            "did you mean 'fanuc'",
            ["robot_pose.notation"],
        ),
        (
            "/v1/runs",
            {"name": "x", "plan": "p", "driver": {"kind": "simulated", "lamp": 1}},
            "key 'driver.lamp' is unknown",
            ["driver.lamp"],
        ),
        (
            "/v1/runs",
            {"name": "x", "plan": "p", "driver": {}},
            "driver needs its kind: simulated, replay, genicam or rc_visard",
            ["driver"],
        ),
    ],
)
def test_keys_are_named_as_the_body_has_them(client, path, body, words, keys):
    got = client.post(path, json=body)
    assert got.status_code == 422
    assert words in got.json()["error"]
    assert got.json()["facts"]["keys"] == keys
