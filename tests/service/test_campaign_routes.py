"""Campaigns over HTTP."""

import csv
import io
import shutil

import cv2
import numpy as np
import pytest
from tests.service.run_cases import serving_here

from exposight.cell import CampaignFolder
from exposight.observing import Observer, observe_campaign, view_features


@pytest.fixture
def served(run_folder):
    """Return the folder to measure in."""
    return run_folder


@pytest.fixture
def client(served):
    """Return a client of the folder."""
    with serving_here(served) as opened:
        yield opened


def got(client, path, **options):
    answer = client.get(f"/v1/campaigns{path}", **options)
    assert answer.status_code == 200, answer.text
    return answer


def test_campaigns_are_listed_with_what_they_are_of(client, served):
    listed = {each["name"]: each for each in got(client, "").json()["campaigns"]}
    assert set(listed) == {"recorded", "whole", "expected", "sheet-expected"}
    campaign = CampaignFolder(served / "sheet-expected")
    assert listed["sheet-expected"] == {
        "name": "sheet-expected",
        "part": campaign.part.name,
        "sensor": campaign.sensor.name,
        "n_captures": len(campaign),
        "views": list(dict.fromkeys(each.view for each in campaign.descriptions())),
        "exposures_ms": [30.0, 50.0, 70.0, 90.0],
    }
    details = got(client, "/sheet-expected").json()
    assert [each["name"] for each in details["features"]] == ["h0", "h1"]
    assert details["features"][0]["radius_mm"] == campaign.part.features[0].radius_mm


def test_a_damaged_campaign_is_left_out_of_the_list_and_named_when_asked_for(client, served):
    (served / "whole" / "campaign.json").write_text("{")
    assert "whole" not in {each["name"] for each in got(client, "").json()["campaigns"]}
    answer = client.get("/v1/campaigns/whole")
    assert answer.status_code == 422
    assert answer.json()["kind"] == "DamagedFileError"


def test_a_campaign_that_grew_has_another_etag(client, served):
    folder = served / "whole" / "captures"
    shutil.move(folder / "000002", served / "aside")
    first = got(client, "/whole/captures")
    assert [each["number"] for each in first.json()["captures"]] == [0, 1]
    known = {"If-None-Match": first.headers["etag"]}
    assert client.get("/v1/campaigns/whole/captures", headers=known).status_code == 304
    shutil.move(served / "aside", folder / "000002")
    grown = got(client, "/whole/captures", headers=known)
    assert [each["number"] for each in grown.json()["captures"]] == [0, 1, 2]
    assert grown.headers["etag"] != first.headers["etag"]
    pose = CampaignFolder(served / "whole").capture(1).camera_from_part
    assert grown.json()["captures"][1]["camera_from_part"] == pose.to_matrix().tolist()


def test_images_are_as_kept_or_smaller(client, served):
    whole = got(client, "/recorded/captures/0/image")
    assert whole.headers["content-type"] == "image/png"
    kept = served / "recorded" / "captures" / "000000" / "image.png"
    assert whole.content == kept.read_bytes()
    small = got(client, "/recorded/captures/0/image?width=60")
    assert small.headers["content-type"] == "image/jpeg"
    pixels = cv2.imdecode(np.frombuffer(small.content, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert pixels.shape == (45, 60)
    full = cv2.imread(str(kept), cv2.IMREAD_GRAYSCALE)
    wanted = cv2.resize(full, (60, 45), interpolation=cv2.INTER_AREA)
    assert np.abs(pixels.astype(float) - wanted).mean() < 3
    assert got(client, "/recorded/captures/0/image?width=4000").content == whole.content
    for answer, query in ((whole, ""), (small, "?width=60")):
        known = {"If-None-Match": answer.headers["etag"]}
        path = f"/v1/campaigns/recorded/captures/0/image{query}"
        assert client.get(path, headers=known).status_code == 304
    assert whole.headers["etag"] != small.headers["etag"]


@pytest.mark.parametrize("name", ["recorded", "sheet-expected"])
def test_rings_are_where_the_masks_are_and_as_good_as_observed(client, served, name):
    campaign = CampaignFolder(served / name)
    number = 1
    about = campaign.capture(number)
    rings = got(client, f"/{name}/captures/{number}/rings").json()
    camera = campaign.sensor.camera
    assert (rings["width"], rings["height"]) == (camera.width, camera.height)
    observed = Observer(campaign.part, campaign.sensor).observe(about)
    p_norm = {each.feature: each.p_norm for each in observed}
    views = view_features(campaign.part, campaign.sensor, about.camera_from_part)
    for ring, view in zip(rings["rings"], views, strict=True):
        assert (ring["feature"], ring["status"]) == (view.feature.name, view.visibility.value)
        u, v = np.array(ring["outline"]).T
        assert u.min() <= view.columns.min() + 1.5
        assert u.max() >= view.columns.max() - 1.5
        assert v.min() <= view.rows.min() + 1.5
        assert ring["p_norm"] == p_norm[ring["feature"]]


def test_observations_are_those_kept(client, served):
    expected = observe_campaign(CampaignFolder(served / "recorded")).frame
    rows = got(client, "/recorded/observations").json()["observations"]
    assert [(r["feature"], r["exposure_ms"], r["p_norm"]) for r in rows] == list(
        expected.select("feature", "exposure_ms", "p_norm").iter_rows()
    )
    text = got(client, "/recorded/observations?format=csv")
    assert text.headers["content-type"].startswith("text/csv")
    assert len(list(csv.DictReader(io.StringIO(text.text)))) == len(rows)
    known = {"If-None-Match": text.headers["etag"]}
    again = client.get("/v1/campaigns/recorded/observations?format=csv", headers=known)
    assert again.status_code == 304
    none = client.get("/v1/campaigns/sheet-expected/observations")
    assert none.status_code == 409
    assert "exposight observe" in none.json()["error"]


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/none", 404),
        ("/scene", 404),
        ("/../x", 404),
        ("/..%2f..%2fetc", 422),
        ("/recorded/captures/99/image", 404),
        ("/recorded/captures/-1/image", 404),
        ("/recorded/captures/x/rings", 422),
        ("/recorded/captures/99999999999999999999999/rings", 404),
        ("/recorded/captures/0/image?width=0", 422),
        ("/recorded/captures/0/image?width=1e9", 422),
        ("/recorded/observations?format=xml", 422),
        ("/%00", 422),
    ],
)
def test_what_is_not_there_is_refused(client, path, status):
    assert client.get(f"/v1/campaigns{path}").status_code == status


def test_damaged_images_are_refused(client, served):
    image = served / "recorded/captures/000000/image.png"
    image.write_bytes(image.read_bytes()[:-20])
    for query in ("", "?width=60"):
        answer = client.get(f"/v1/campaigns/recorded/captures/0/image{query}")
        assert answer.status_code == 422
        assert answer.json()["kind"] == "DamagedFileError"


def numbers(client, name):
    return [each["number"] for each in got(client, f"/{name}/captures").json()["captures"]]


def test_an_unfinished_capture_is_none_until_it_is_finished(client, served):
    folder = served / "whole" / "captures" / "000007"
    folder.mkdir()
    assert numbers(client, "whole") == [0, 1, 2]
    assert got(client, "/whole").json()["n_captures"] == 3
    assert "whole" in {each["name"] for each in got(client, "").json()["campaigns"]}
    assert got(client, "/whole/observations").json()["observations"]
    for what in ("image", "rings"):
        assert client.get(f"/v1/campaigns/whole/captures/7/{what}").status_code == 404
    assert numbers(client, "whole") == [0, 1, 2]
    for path in (served / "whole/captures/000002").iterdir():
        path.rename(folder / path.name)
    (served / "whole/captures/000002").rmdir()
    assert numbers(client, "whole") == [0, 1, 7]


def test_a_capture_that_lost_its_description_is_not_there(client, served):
    assert numbers(client, "whole") == [0, 1, 2]
    (served / "whole/captures/000001/capture.json").unlink()
    assert numbers(client, "whole") == [0, 2]
    assert got(client, "/whole").json()["n_captures"] == 2
    for what in ("image", "rings"):
        assert client.get(f"/v1/campaigns/whole/captures/1/{what}").status_code == 404


@pytest.mark.parametrize("opened_before", [True, False])
@pytest.mark.parametrize(
    "place", ["000001", "000001/image.png", "000001/capture.json", "000001/observations.csv"]
)
def test_captures_that_lead_out_are_not_there(client, served, tmp_path, place, opened_before):
    outside = shutil.copytree(served / "recorded", tmp_path / "outside")
    before = len(CampaignFolder(served / "recorded"))
    if opened_before:
        got(client, "/recorded/captures/1/image")
    (served / "recorded/captures" / place).rename(served / "aside")
    (served / "recorded/captures" / place).symlink_to(outside / "captures" / place)
    for what in ("image", "image?width=60", "rings"):
        assert client.get(f"/v1/campaigns/recorded/captures/1/{what}").status_code == 404
    assert 1 not in numbers(client, "recorded")
    rows = got(client, "/recorded/observations").json()["observations"]
    assert len({(each["view"], each["exposure_ms"]) for each in rows}) == before - 1
    assert got(client, "/recorded/captures/0/image").content
