"""Captures that are sent: observed at once, or fed to a closed loop."""

import io
import json
import shutil
import threading
import zlib

import cv2
import numpy as np
import pytest

from exposight.cell import MemoryCampaign, write_cloud
from exposight.cell.cloud_archive import npz_of
from exposight.geometry import RigidTransform
from exposight.measuring import loop_step
from exposight.observing import observe_campaign, open_campaign
from exposight.service.guard import Limits

ABOUT = {"campaign": "campaign"}
BEGIN = {"plan": "plan.json", "models": "models", "campaign": "campaign"}


def parts(folder, **files):
    given = {name: (folder / name) for name in ("image.png", "cloud.ply")}
    sent = {path.stem: (name, path.read_bytes()) for name, path in given.items()}
    return {**sent, **files}


def observe(client, about, files):
    return client.post("/v1/observe", data={"about": json.dumps(about)}, files=files)


@pytest.fixture(scope="module")
def about(capture_of):
    pose = capture_of("v1", 8.0).camera_from_part
    return {**ABOUT, "exposure_ms": 8.0, "camera_from_part": pose.to_matrix().tolist()}


def test_an_upload_is_observed_as_the_library_does(
    client, about, capture_files, capture_of, original
):
    got = observe(client, {**about, "view": "v1"}, parts(capture_files))
    assert got.status_code == 200, got.text
    campaign = open_campaign(original / "campaign")
    (number,) = (
        number
        for number, key in zip(campaign.numbers, campaign.keys(), strict=True)
        if key == ("v1", 8.0)
    )
    source = MemoryCampaign(
        name="one",
        sensor=campaign.sensor,
        part=campaign.part,
        captures=[campaign.capture(number)],
    )
    expected = observe_campaign(source).frame.to_dicts()
    rows = got.json()["observations"]
    assert [each["feature"] for each in rows] == [each["feature"] for each in expected]
    for row, other in zip(rows, expected, strict=True):
        for name in ("p_norm", "i_avg", "n_points", "n_pixels", "x_mm", "w_deg", "visibility"):
            wanted = other[name]
            missing = isinstance(wanted, float) and np.isnan(wanted)
            assert row[name] == (None if missing else wanted)


def test_a_pose_that_puts_the_part_elsewhere_is_a_contradiction(client, about, capture_files):
    shifted = RigidTransform(translation_mm=np.array([0.0, 0.0, 690.0])).to_matrix().tolist()
    got = observe(client, {**about, "camera_from_part": shifted}, parts(capture_files))
    assert got.status_code == 422
    assert got.json()["kind"] == "ContradictionError"
    (first, *_) = got.json()["facts"]["contradictions"]
    assert {"check", "compared", "found", "explanation"} <= first.keys()


def _png_of(rows, columns):
    """A PNG whose header announces a size."""
    header = b"IHDR" + np.array([columns, rows], dtype=">u4").tobytes() + bytes([8, 0, 0, 0, 0])
    png = b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + header
    png += zlib.crc32(header).to_bytes(4, "big")
    body = zlib.compress(bytes(200_000))
    data = b"IDAT" + body
    png += len(body).to_bytes(4, "big") + data + zlib.crc32(data).to_bytes(4, "big")
    return png + bytes(4) + b"IEND" + zlib.crc32(b"IEND").to_bytes(4, "big")


@pytest.mark.parametrize(
    ("image", "status"),
    [(b"no image", 422), (b"", 422), (b"\x89PNG\r\n\x1a\n", 422), (_png_of(30_000, 30_000), 413)],
)
def test_an_image_that_is_none_or_too_large(client, about, capture_files, image, status):
    got = observe(client, about, parts(capture_files, image=("image.png", image)))
    assert got.status_code == status, got.text
    assert "/tmp" not in got.text


def test_a_cloud_that_is_none(client, about, capture_files):
    for name, data in (("cloud.ply", b"no cloud"), ("cloud", b""), ("../../x.ply", b"ply\n")):
        got = observe(client, about, parts(capture_files, cloud=(name, data)))
        assert got.status_code == 422, got.text


def test_parts_that_are_missing_or_too_many(client, about, capture_files):
    files = parts(capture_files)
    assert client.post("/v1/observe", files=files).status_code == 422
    assert observe(client, about, {"image": files["image"]}).status_code in {415, 422}
    assert observe(client, about, {**files, "other": ("o", b"1")}).status_code == 400
    assert client.post("/v1/observe", json=about).status_code == 415
    assert observe(client, {**about, "exposure": 1}, files).status_code == 422
    lacking = {key: value for key, value in about.items() if key != "exposure_ms"}
    assert "exposure_ms" in observe(client, lacking, files).json()["error"]


def test_a_missing_part_is_an_input_error(client, about, capture_files):
    files = parts(capture_files)
    for got in (
        client.post("/v1/observe", files=files),
        observe(client, about, {"image": files["image"]}),
    ):
        assert (got.status_code, got.json()["kind"]) == (422, "InputError")


def test_what_an_npz_cloud_tells_itself_is_refused(client, about, capture_files, capture_of):
    files = parts(capture_files, cloud=("c.npz", npz_of(capture_of("v1", 8.0).cloud)))
    assert observe(client, about, files).status_code == 200
    for form in ({"cloud_unit": "m"}, {"cloud_axes": ["x", "-y", "-z"]}, {"depth_scale_mm": 0.1}):
        got = observe(client, {**about, "files": form}, files)
        assert got.status_code == 422
        assert f"files.{next(iter(form))}" in got.json()["error"]


@pytest.mark.parametrize(
    "extra", [{"exposure_ms": 8.0}, {"view": "v1"}, {"files": {"cloud_unit": "mm"}}]
)
def test_what_is_of_a_capture_needs_one(served, asking, extra):
    with asking(served) as client:
        got = client.post("/v1/next", json={"loop": "plate", **BEGIN, **extra})
        assert got.status_code == 422
        assert "image and cloud are missing" in got.json()["error"]
        assert not (served / "loops" / "plate.json").exists()


def _files_of(capture):
    image = cv2.imencode(".png", np.asarray(capture.image))[1].tobytes()
    return image, capture.cloud


def test_a_loop_goes_on_until_it_is_done(served, asking, capture_of, tmp_path):
    with asking(served) as client:
        got = client.post("/v1/next", json={"loop": "plate", **BEGIN, "unit": "us"}).json()
        steps = 0
        while not got["done"]:
            request = got["request"]
            assert request["set_value"] == 1000.0 * request["exposure_ms"]
            pose = RigidTransform.from_matrix(request["camera_from_part"])
            capture = capture_of(request["view"], request["exposure_ms"], pose, light=0.7)
            image, cloud = _files_of(capture)
            write_cloud(tmp_path / "cloud.ply", cloud)
            files = {
                "image": ("image.png", image),
                "cloud": ("cloud.ply", (tmp_path / "cloud.ply").read_bytes()),
            }
            sent = json.dumps(
                {"loop": "plate", "unit": "us", "exposure_ms": request["exposure_ms"]}
            )
            got = client.post("/v1/next", data={"about": sent}, files=files).json()
            steps += 1
            assert got["n_captures"] == steps <= 8, got
            assert len(got["decisions"]) == 1
        assert {each["status"] for each in got["outcomes"]} <= {"had", "given up", "not seen"}
        assert sum(each["status"] == "had" for each in got["outcomes"]) == 12
        assert "12 of 13" in got["verdict"]
    with loop_step(served / "loops" / "plate.json") as step:
        assert step is not None
        assert len(step.decisions) == steps


def test_what_was_sent_twice_is_known_already(served, asking, capture_of, about, capture_files):
    with asking(served) as client:
        client.post("/v1/next", json={"loop": "plate", **BEGIN})
        rows = observe(client, {**about, "view": "v1"}, parts(capture_files)).json()
        body = {"loop": "plate", "observations": rows["observations"]}
        first = client.post("/v1/next", json=body)
        assert first.status_code == 200, first.text
        again = client.post("/v1/next", json=body).json()
        assert (first.json()["n_captures"], again["n_captures"]) == (1, 1)
        assert "known already" in again["known"][0]
        sent = {"about": json.dumps({"loop": "plate", "exposure_ms": 8.0, "view": "v1"})}
        third = client.post("/v1/next", data=sent, files=parts(capture_files)).json()
        fourth = client.post("/v1/next", data=sent, files=parts(capture_files)).json()
        assert third["n_captures"] == fourth["n_captures"]


def test_captures_by_the_name_of_a_campaign(served, asking):
    with asking(served) as client:
        client.post("/v1/next", json={"loop": "plate", **BEGIN})
        got = client.post("/v1/next", json={"loop": "plate", "captures": ["campaign"]})
        # it has views that the plan has not
        assert got.status_code == 422
        assert "the plan has no view" in got.json()["error"]
        got = client.post("/v1/next", json={"loop": "plate", "captures": ["../served"]})
        assert got.status_code == 422


def test_loops_that_cannot_be(served, asking):
    with asking(served) as client:
        assert client.post("/v1/next", json={"loop": "none"}).status_code == 404
        for name in ("../x", "a/b", "", ".hidden", "x" * 200):
            got = client.post("/v1/next", json={"loop": name, **BEGIN})
            assert got.status_code == 422, name
        assert client.post("/v1/next", json={"loop": "a", **BEGIN}).status_code == 200
        other = {**BEGIN, "campaign": None, "features": "features.csv", "sensor": "sensor.json"}
        assert client.post("/v1/next", json={"loop": "a", **BEGIN}).status_code == 200
        got = client.post("/v1/next", json={"loop": "a", **other, "plan": "nothing.json"})
        assert got.status_code == 404
        got = client.post("/v1/next", json={"loop": "a", "observations": [{"feature": "h01"}]})
        assert got.status_code == 422, got.text


def test_another_client_at_the_same_loop_is_told_so(served, asking):
    with asking(served) as client:
        client.post("/v1/next", json={"loop": "plate", **BEGIN})
        with loop_step(served / "loops" / "plate.json"):
            got = client.post("/v1/next", json={"loop": "plate"})
        assert got.status_code == 409
        assert got.json()["kind"] == "Conflict"
        assert client.post("/v1/next", json={"loop": "plate"}).status_code == 200


def test_two_clients_beginning_one_loop(served, asking):
    with asking(served) as client:
        statuses = []

        def begin():
            statuses.append(client.post("/v1/next", json={"loop": "one", **BEGIN}).status_code)

        threads = [threading.Thread(target=begin) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert set(statuses) <= {200, 409}
        assert 200 in statuses


def test_a_body_beyond_the_limit_is_refused_while_it_arrives(original, asking, about):
    with asking(original, Limits(body_bytes=100_000)) as client:
        announced = observe(client, about, {"image": ("i", bytes(200_000))})
        assert announced.status_code == 413

        def pieces():
            for _ in range(1000):
                yield bytes(10_000)

        sent = client.post(
            "/v1/recommend", content=pieces(), headers={"Content-Type": "application/json"}
        )
        assert sent.status_code == 413
        boundary = {"Content-Type": "multipart/form-data; boundary=x"}
        head = b'--x\r\nContent-Disposition: form-data; name="image"; filename="a"\r\n\r\n'
        body = io.BytesIO(head + bytes(200_000)).read()
        got = client.post("/v1/observe", content=iter([body]), headers=boundary)
        assert got.status_code == 413, got.text


def test_loops_that_are_refused_leave_nothing(served, asking):
    with asking(served) as client:
        assert client.post("/v1/next", json={"loop": "nope"}).status_code == 404
        got = client.post("/v1/next", json={"loop": "nope", **BEGIN, "plan": "nothing.json"})
        assert got.status_code == 404
    assert not (served / "loops").exists()


@pytest.mark.parametrize("place", ["captures/000001", "captures/000001/image.png"])
def test_captures_that_lead_out_are_not_fed(served, asking, tmp_path, place):
    shutil.copytree(served / "campaign", tmp_path / "outside")
    inner = served / "campaign" / place
    shutil.rmtree(inner) if inner.is_dir() else inner.unlink()
    inner.symlink_to(tmp_path / "outside" / place)
    with asking(served) as client:
        client.post("/v1/next", json={"loop": "plate", **BEGIN})
        got = client.post("/v1/next", json={"loop": "plate", "captures": ["campaign"]})
        assert got.status_code == 404, got.text
        assert "leads out" in got.json()["error"]
