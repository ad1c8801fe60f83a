"""What the writer of a campaign refuses, the reader refuses, though all checksums are right."""

from __future__ import annotations

import copy
import json
import shutil
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.fuzz.own_files import put_in, reseal_document

from exposight.cell import CampaignFolder, CampaignWriter, Capture, Cloud, StackImages
from exposight.cell.capture import write_capture
from exposight.errors import FormatError, InputError

ROWS, COLUMNS = 12, 16


@pytest.fixture
def folder(tmp_path, sensor, part, make_capture):
    path = tmp_path / "campaign"
    with CampaignWriter.open_or_create(path, name="few", sensor=sensor, part=part) as writer:
        writer.add(make_capture())
    return path


def forged(good: Capture, **changes) -> Capture:
    """Return a capture as no constructor lets it pass."""
    capture = copy.copy(good)
    for name, value in changes.items():
        object.__setattr__(capture, name, value)
    return capture


def writer_takes(campaign: CampaignFolder, capture: Capture) -> bool:
    given = {each.name: getattr(capture, each.name) for each in fields(capture) if each.init}
    try:
        Capture(**given).check_fits(campaign.sensor)
    except InputError:
        return False
    return True


def reader_takes(campaign: CampaignFolder, capture: Capture) -> bool:
    place = campaign.path / "captures" / "000001"
    shutil.rmtree(place, ignore_errors=True)
    write_capture(place, capture)
    try:
        list(CampaignFolder(campaign.path).captures())
    except FormatError:
        return False
    return True


def grey(rows=ROWS, columns=COLUMNS, kind=np.uint8):
    return np.full((rows, columns), 200, dtype=kind)


def points(*shape):
    return Cloud(points=np.full((*shape, 3), 500.0))


def stack(one=None, other=None):
    return StackImages(maximum=grey() if one is None else one, modulation=grey()[:, ::-1].copy()
                       if other is None else other)  # fmt: skip


WRONG = {
    "the image turned": {"image": grey(COLUMNS, ROWS)},
    "an image of another size": {"image": grey(24, 32)},
    "another bit depth": {"bit_depth": 10},
    "16 bits where 8 are said": {"image": grey(kind=np.uint16)},
    "grey levels beyond the bit depth": {
        "image": grey(kind=np.uint16) * np.uint16(20), "bit_depth": 10,
    },
    "the cloud turned": {"cloud": points(COLUMNS, ROWS)},
    "a cloud of another size": {"cloud": points(5, 7)},
    "a finer cloud": {"cloud": points(24, 32)},
    "too long an exposure": {"exposure_ms": 1000.5},
    "too short an exposure": {"exposure_ms": 0.5},
    "no name": {"view": " "},
    "a stack image of another size": {"stack": stack(grey(24, 32))},
    "a stack image turned": {"stack": stack(grey(), grey(COLUMNS, ROWS))},
    "a stack image of more bits": {"stack": stack(grey(kind=np.uint16))},
    "a stack's mean beside the mean": {
        "stack": StackImages(mean=grey(), maximum=grey(), modulation=grey()),
        "brightness_source": "stripes-mean",
    },
}  # fmt: skip


@pytest.mark.parametrize("changes", WRONG.values(), ids=list(WRONG))
def test_neither_writer_nor_reader_takes(folder, make_capture, changes):
    capture = forged(make_capture(20.0), **changes)
    campaign = CampaignFolder(folder)
    assert reader_takes(campaign, make_capture(20.0))
    assert not writer_takes(campaign, capture)
    assert not reader_takes(campaign, capture)


def test_a_turned_image_is_named_with_both_sizes(folder, make_capture):
    write_capture(
        folder / "captures" / "000001", forged(make_capture(20.0), image=grey(COLUMNS, ROWS))
    )
    with pytest.raises(FormatError, match=r"000001/image\.png .*16 rows × 12 .*12 × 16"):
        CampaignFolder(folder).capture(1)


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    image=st.sampled_from([(12, 16), (16, 12), (6, 8), (1, 192)]),
    cloud=st.sampled_from([(12, 16), (6, 8), (16, 12), (4, 4), (3, 4), (192,), (0,), None]),
    bit_depth=st.integers(6, 18),
    wide=st.booleans(),
    exposure_ms=st.floats(0.5, 2000.0),
)
def test_the_reader_takes_what_the_writer_takes(
    folder, make_capture, image, cloud, bit_depth, wide, exposure_ms
):
    capture = forged(
        make_capture(20.0),
        image=grey(*image, np.uint16 if wide else np.uint8),
        cloud=None if cloud is None else points(*cloud),
        bit_depth=bit_depth,
        exposure_ms=exposure_ms,
    )
    campaign = CampaignFolder(folder)
    assert reader_takes(campaign, capture) == writer_takes(campaign, capture)


@pytest.mark.parametrize("look", ["captures", "descriptions", "keys"])
def test_a_copied_capture_is_refused(folder, look):
    shutil.copytree(folder / "captures" / "000000", folder / "captures" / "000003")
    with pytest.raises(FormatError, match=r"000003 holds .*'v1' at 10 ms, and so does 000000"):
        list(getattr(CampaignFolder(folder), look)())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("camera_from_part", [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 2, 600], [0, 0, 0, 1]]),
        ("camera_from_part", [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 600], [0, 0, 0, 1]]),
        ("beside_sha256", {"../../sensor.json": "0" * 64}),
        ("beside_sha256", {"image.png": "0" * 64}),
        ("exposure_ms", 5000.0),
        ("view", ""),
        ("bit_depth", 7),
        ("bit_depth", 8.5),
        ("emulated", "yes"),
        ("brightness_source", "moonlight"),
    ],
)
def test_a_description_that_no_writer_makes_is_refused(folder, key, value):
    path = folder / "captures" / "000000" / "capture.json"
    content = {**json.loads(path.read_bytes()), key: value}
    path.write_bytes(reseal_document(b"", json.dumps(content).encode()))
    with pytest.raises(FormatError):
        list(CampaignFolder(folder).captures())


@pytest.mark.parametrize(
    "change",
    [
        lambda arrays: {**arrays, "shape": np.array([12, 15])},
        lambda arrays: {**arrays, "shape": np.array([-12, -16])},
        lambda arrays: {**arrays, "shape": np.array([12.0, 16.0])},
        lambda arrays: {**arrays, "points": arrays["points"][:-1]},
        lambda arrays: {**arrays, "points": arrays["points"][:1]},
        lambda arrays: {**arrays, "points": arrays["points"] * np.nan},
        lambda arrays: {**arrays, "points": arrays["points"] * 0},
        lambda arrays: {**arrays, "points": arrays["points"].astype(np.float64)},
        lambda arrays: {**arrays, "valid": arrays["valid"][:-1]},
        lambda arrays: {**arrays, "valid": np.append(arrays["valid"], np.uint8(0))},
        lambda arrays: {**arrays, "sigma_z_mm": -np.ones(len(arrays["points"]), np.float32)},
        lambda arrays: {**arrays, "sigma_z_mm": np.ones(1, np.float32)},
        lambda arrays: {**arrays, "colours": np.zeros(3)},
        lambda arrays: {"shape": arrays["shape"], "valid": arrays["valid"]},
    ],
)
def test_a_cloud_that_no_writer_packs_is_refused(folder, change, tmp_path):
    name = "captures/000000/cloud.npz"
    with np.load(folder / name) as archive:
        arrays = dict(archive)
    np.savez(tmp_path / "cloud.npz", **change(arrays))
    put_in(folder, name, (tmp_path / "cloud.npz").read_bytes())
    with pytest.raises(FormatError, match=r"cloud\.npz"):
        list(CampaignFolder(folder).captures())


@pytest.mark.parametrize("length", [b"\x7f\xff\xff\xff", b"\0\0\0\0"])
def test_an_image_whose_chunks_do_not_fit_is_refused_before_it_is_decoded(folder, length):
    name = "captures/000000/image.png"
    data = (folder / name).read_bytes()
    at = data.index(b"IDAT")
    put_in(folder, name, data[: at - 4] + length + data[at:])
    with pytest.raises(FormatError, match=r"image\.png: cannot be read as an image"):
        CampaignFolder(folder).capture(0)
