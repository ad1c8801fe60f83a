"""Who is answered, and what bodies and names are refused."""

import json
import os
import time

import pytest

from exposight.errors import ExposightError, InputError, MissingFileError
from exposight.service.folder import ServedFolder, check_name
from exposight.service.guard import Limits

JSON = {"Content-Type": "application/json"}
ABOUT = {"models": "models", "campaign": "campaign", "view": "v1"}
PLAN = {"models": "models", "campaign": "campaign"}
TOKEN = "a-token-of-enough-characters"


def _keys(number, value):
    return b", ".join(b'"k%d":%s' % (each, value) for each in range(number))


def test_a_token_is_needed_where_there_is_one(original, asking):
    with asking(original, token=TOKEN) as client:
        for given in (None, "Bearer", f"Bearer {TOKEN}x", f"Basic {TOKEN}", TOKEN, "Bearer é"):
            headers = {} if given is None else {"Authorization": given.encode()}
            got = client.get("/v1/health", headers=headers)
            assert got.status_code == 401
            assert got.headers["www-authenticate"] == "Bearer"
            assert client.get("/openapi.json", headers=headers).status_code == 401
        good = {"Authorization": f"Bearer {TOKEN}", "Host": "cell-7.example"}
        assert client.get("/v1/health", headers=good).status_code == 200


@pytest.mark.parametrize("host", ["cell.example", "127.0.0.1.example", "", "[::1", "a@b:1", "\xff"])
def test_without_a_token_only_loopback_hosts_are_answered(client, host):
    assert client.get("/v1/health", headers={"Host": host.encode("latin1")}).status_code == 403


@pytest.mark.parametrize("host", ["localhost:8765", "127.0.0.1", "[::1]:8765"])
def test_loopback_hosts(client, host):
    assert client.get("/v1/health", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_pages_of_other_origins_are_not_answered(client, headers):
    assert client.get("/v1/health", headers=headers).status_code == 403
    same = {"Origin": "http://127.0.0.1", "Sec-Fetch-Site": "same-origin"}
    assert client.get("/v1/health", headers=same).status_code == 200


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[]",
        b"null",
        b"\xff\xfe",
        b"{",
        b'{"models": NaN}',
        b'{"models": Infinity}',
        b'{"models": "a", "models": "b"}',
        b'{"models": ' + b"[" * 10_000 + b"]" * 10_000 + b"}",
        b'{"models": ' + b"[" * 150 + b"]" * 150 + b"}",
        b'{"confidence": 1e309}',
        b'{"most_per_view": ' + b"9" * 5000 + b"}",
        b'{"models": "\\ud800"}',
    ],
)
@pytest.mark.parametrize("path", ["/v1/recommend", "/v1/forecast", "/v1/plan", "/v1/next"])
def test_json_that_is_none(client, path, body):
    got = client.post(path, content=body, headers=JSON)
    assert got.status_code == 422, got.text[:200]
    assert set(got.json()) == {"error", "kind", "facts"}
    assert len(got.content) < 2000


@pytest.mark.parametrize(
    "name", ["Host", "Origin", "Sec-Fetch-Site", "Authorization", "Content-Length"]
)
def test_headers_that_decide_are_there_once(client, name):
    value = {"Host": "127.0.0.1", "Content-Length": "0"}.get(name, "none")
    got = client.get("/v1/health", headers=[(name, value), (name, value)])
    assert got.status_code == 400
    assert name.lower() in got.json()["error"]


def test_head_is_answered_as_get_is(client):
    got = client.head("/v1/health")
    assert (got.status_code, got.content) == (200, b"")
    assert client.head("/v1/recommend").status_code == 405
    assert client.head("/nothing").status_code == 404


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        ("/v1/next", b'{"loop": "door", "observations": [' + b"{}," * 2_600_000 + b"{}]}", 413),
        ("/v1/next", b'{"loop": "door", "observations": [' + b"{}," * 6_000_000 + b"{}]}", 413),
        ("/v1/next", b'{"loop": "door", "observations": [' + b"{}," * 490_000 + b"{}]}", 413),
        ("/v1/next", b'{"loop": "door", "observations": [' + b"[]," * 19_990 + b"{}]}", 422),
        ("/v1/next", b'{"loop": "door", "observations": [{' + _keys(490_000, b"0") + b"}]}", 422),
        ("/v1/next", b'{"loop": "door", "captures": [' + b"1," * 490_000 + b"1]}", 422),
        ("/v1/next", b'{"camera_from_part": [[' + b'"",' * 490_000 + b"1]]}", 422),
        ("/v1/recommend", b"{" + _keys(150_000, b"0") + b"}", 422),
        ("/v1/recommend", b"{" + _keys(150_000, b"0") + b', "k149999": 0}', 422),
        ("/v1/recommend", b"{" + _keys(200_000, b"0") + b"}", 413),
        ("/v1/plan", b'{"views": [' + b"1," * 510_000 + b"1]}", 413),
    ],
)
def test_no_body_in_json_keeps_the_server_long(client, path, body, status):
    begun = time.process_time()
    got = client.post(path, content=body, headers=JSON)
    assert time.process_time() - begun < 1.5
    assert got.status_code == status
    assert len(got.content) < 10_000


def test_other_types_of_bodies_paths_and_methods(client):
    body = json.dumps(ABOUT).encode()
    for kind in ("text/plain", "", "application/xml", "multipart/form-data"):
        got = client.post("/v1/recommend", content=body, headers={"Content-Type": kind})
        assert got.status_code == 415
    assert client.get("/nothing").status_code == 404
    assert client.get("/docs").status_code == 404
    assert client.get("/v1/recommend").status_code == 405
    assert client.get("/v1/health", params={"x": "y" * 3000}).status_code == 414


@pytest.mark.parametrize(
    "name",
    [
        *("..", "../x", "a/../..", "/etc/passwd", "a//b", "", "a/", "./a", "C:x", "a\\b", "a\0b"),
        *("a\nb", "x" * 256, "%2e%2e/x/../.."),
    ],
)
def test_names_that_are_no_plain_paths(client, name):
    with pytest.raises(InputError):
        check_name(name, "file")
    got = client.post("/v1/recommend", json={**ABOUT, "models": name})
    assert got.status_code == 422


def test_nothing_outside_the_folder_is_reached(served, asking, tmp_path, original):
    outside = tmp_path / "outside"
    (outside / "models").mkdir(parents=True)
    (served / "link").symlink_to(original / "models")
    (served / "inner").symlink_to(served / "models")
    (served / "file.json").symlink_to(original / "plan.json")
    os.mkfifo(served / "pipe.json")
    folder = ServedFolder(served)
    with pytest.raises(MissingFileError):
        folder.inside("link")
    with pytest.raises(MissingFileError):
        folder.exposure_plan("file.json")
    with pytest.raises(MissingFileError):
        folder.new("link/new.json")
    with pytest.raises(ExposightError):
        folder.exposure_plan("pipe.json")
    assert folder.inside("inner") == served / "models"
    with asking(served) as client:
        for name in ("link", "link/quality.exposight-model"):
            assert client.post("/v1/recommend", json={**ABOUT, "models": name}).status_code == 404
        body = {"models": "models", "campaign": "campaign", "save_as": "link/x.json"}
        assert client.post("/v1/plan", json=body).status_code == 404
        assert client.get("/v1/%2e%2e/%2e%2e/etc/passwd").status_code == 404
    assert not list(outside.rglob("*.json"))


def test_a_model_file_that_leads_out_is_not_read(served, asking, original):
    models = served / "models"
    (served / "inner").mkdir()
    for path in models.iterdir():
        (served / "inner" / path.name).symlink_to(path)
    with asking(served) as client:
        assert client.post("/v1/recommend", json={**ABOUT, "models": "inner"}).status_code == 200
        for path in sorted(models.iterdir()):
            path.unlink()
            path.symlink_to(original / "models" / path.name)
            for name in ("models", "inner"):
                got = client.post("/v1/recommend", json={**ABOUT, "models": name})
                assert got.status_code == 404, got.text
                assert "leads out" in got.json()["error"]


@pytest.mark.parametrize("name", ["campaign.json", "sensor.json", "features.csv", "captures"])
def test_a_campaigns_file_that_leads_out_is_not_read(served, asking, original, name):
    (served / "campaign" / name).rename(served / "aside")
    (served / "campaign" / name).symlink_to(original / "campaign" / name)
    with asking(served) as client:
        assert client.post("/v1/recommend", json=ABOUT).status_code == 404
        assert client.get("/v1/campaigns/campaign").status_code == 404


def test_a_folder_that_was_moved_away_is_not_made_again(served, asking, tmp_path):
    with asking(served) as client:
        served.rename(tmp_path / "moved")
        health = client.get("/v1/health")
        assert (health.status_code, health.json()["status"]) == (200, "folder missing")
        run = {"name": "r", "plan": "plan.json", "driver": {"kind": "simulated"}}
        begin = {"loop": "a", "plan": "plan.json", "models": "models", "campaign": "campaign"}
        answers = [client.get(f"/v1/{name}") for name in ("models", "campaigns", "plans")]
        answers += [
            client.post("/v1/recommend", json=ABOUT),
            client.post("/v1/plan", json={**PLAN, "save_as": "p.json"}),
            client.post("/v1/next", json=begin),
            client.post("/v1/runs", json=run),
        ]
        for got in answers:
            assert got.status_code == 404, got.text
            assert "not there any more" in got.json()["error"]
        assert not served.exists()
        (tmp_path / "moved").rename(served)
        assert client.get("/v1/health").json()["status"] == "ok"
        assert client.post("/v1/recommend", json=ABOUT).status_code == 200


def test_messages_do_not_tell_where_the_folder_lies(served, asking):
    (served / "bad").mkdir()
    (served / "bad" / "quality.exposight-model").write_bytes(b"x")
    with asking(served) as client:
        got = client.post("/v1/recommend", json={**ABOUT, "models": "bad"})
        assert got.status_code == 422
        assert str(served) not in got.text
        assert str(served) not in client.get("/v1/models").text


def test_listings(client):
    assert client.get("/v1/health").json()["serves"] == {
        "models": 1,
        "campaigns": 1,
        "exposure_plans": 1,
        "measuring_plans": 0,
        "features": 1,
        "sensors": 1,
    }
    (models,) = client.get("/v1/models").json()["models"]
    assert (models["name"], models["sensor"]) == ("models", "small")
    parts = client.get("/v1/parts").json()["parts"]
    assert {each["name"]: each["part"] for each in parts} == {
        "campaign": "plate",
        "features.csv": "features",
    }
    assert client.get("/v1/plans").json()["exposure_plans"] == ["plan.json"]


def test_more_than_is_taken_at_once(original, asking):
    few = Limits(features=5, views=1, exposures=2)
    with asking(original, few) as client:
        assert client.post("/v1/recommend", json=ABOUT).status_code == 413
    with asking(original, Limits(views=1, exposures=2)) as client:
        body = {"models": "models", "campaign": "campaign"}
        assert client.post("/v1/plan", json=body).status_code == 413
        times = {**ABOUT, "exposures_ms": [1.0, 2.0, 3.0]}
        assert client.post("/v1/forecast", json=times).status_code == 413


def test_the_description_has_an_example_of_each_body_and_answer(client):
    described = client.get("/openapi.json").json()
    for path, methods in described["paths"].items():
        if not path.startswith("/v1/") or path.startswith(("/v1/runs", "/v1/campaigns")):
            continue
        for method, about in methods.items():
            content = about["responses"]["200"]["content"]["application/json"]
            assert "example" in content, path
            if method == "post":
                for kind in about["requestBody"]["content"].values():
                    assert "schema" in kind
            assert {"401", "403", "408", "413", "422"} <= about["responses"].keys()
    for name in ("ForecastQuestion", "RecommendQuestion", "PlanQuestion"):
        assert described["components"]["schemas"][name]["examples"]
