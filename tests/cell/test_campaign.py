import errno
import hashlib
import json
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import (
    CampaignFolder,
    CampaignWriter,
    CaptureSource,
    Cloud,
    Feature,
    MemoryCampaign,
    Part,
    write_numbered_capture,
)
from exposight.errors import (
    CloudError,
    DamagedFileError,
    FileError,
    FormatError,
    ImageError,
    InputError,
    MissingFileError,
    VersionError,
)

POSE_TOLERANCE = 1e-12
"""Reading a pose makes its rotation exactly orthonormal: a few roundings of 1e-16."""


@pytest.fixture
def folder(tmp_path, sensor, part, make_capture):
    """A campaign of three captures."""
    path = tmp_path / "campaign"
    with CampaignWriter.open_or_create(path, name="door", sensor=sensor, part=part) as writer:
        for exposure in (30.0, 10.0, 20.0):
            writer.add(make_capture(exposure))
    return path


def reopen(folder, sensor, part, name="door"):
    return CampaignWriter.open_or_create(folder, name=name, sensor=sensor, part=part)


def assert_same(one, other):
    np.testing.assert_array_equal(one.image, other.image)
    assert one.image.dtype == other.image.dtype
    np.testing.assert_array_equal(one.cloud.points, other.cloud.points)
    np.testing.assert_allclose(
        one.camera_from_part.to_matrix(), other.camera_from_part.to_matrix(), atol=POSE_TOLERANCE
    )
    for name in ("view", "exposure_ms", "bit_depth", "emulated", "notes"):
        assert getattr(one, name) == getattr(other, name)


# -- round trips --------------------------------------------------------------------------------


def test_captures_come_back_as_they_were_in_the_order_they_were_taken(folder, make_capture):
    captures = list(CampaignFolder(folder).captures())
    assert [capture.exposure_ms for capture in captures] == [30, 10, 20]
    for capture in captures:
        assert_same(capture, make_capture(capture.exposure_ms))


@pytest.mark.parametrize("bit_depth", [12, 16])
def test_deeper_images_unorganised_clouds_and_labels_are_kept(
    tmp_path, sensor, part, make_capture, bit_depth
):
    image = np.arange(192, dtype=np.uint16).reshape(12, 16) * (2**bit_depth // 192)
    points = np.random.default_rng(0).normal(size=(77, 3))
    points[::3] = 0
    capture = replace(
        make_capture(), image=image, bit_depth=bit_depth, cloud=Cloud(points=points), emulated=True
    )
    with reopen(tmp_path, sensor, part) as writer:
        writer.add(capture)
    (read,) = CampaignFolder(tmp_path).captures()
    assert_same(read, capture)


def test_a_cloud_without_any_point_is_kept(tmp_path, sensor, part, make_capture):
    with reopen(tmp_path, sensor, part) as writer:
        writer.add(replace(make_capture(), cloud=Cloud(points=np.zeros((12, 16, 3)))))
    (read,) = CampaignFolder(tmp_path).captures()
    assert read.cloud.valid.shape == (12, 16)
    assert read.cloud.n_valid == 0


def test_a_capture_without_its_cloud_comes_back_without(tmp_path, sensor, part, make_capture):
    with reopen(tmp_path, sensor, part) as writer:
        writer.add(replace(make_capture(), cloud=None))
    (read,) = CampaignFolder(tmp_path).captures()
    assert read.cloud is None
    assert not (tmp_path / "captures" / "000000" / "cloud.npz").exists()
    with pytest.raises(CloudError, match="was kept without its cloud"):
        read.require_cloud()


def test_attachments_are_kept_and_read_when_they_are_looked_up(folder, make_capture):
    files = {"a.txt": b"A", "b.txt": b"B"}
    write_numbered_capture(folder, 7, replace(make_capture(5.0), attachments=files))
    campaign = CampaignFolder(folder)
    assert campaign.attachments(7) == files
    assert campaign.attachments(0) == {}
    (folder / "captures" / "000007" / "a.txt").write_bytes(b"C")
    *_, capture = campaign.captures()
    assert capture.attachments["b.txt"] == b"B"
    with pytest.raises(DamagedFileError, match=r"a\.txt is damaged"):
        capture.attachments["a.txt"]


def test_two_writers_of_the_same_capture_both_end_well(folder, make_capture):
    capture = make_capture(5.0)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: write_numbered_capture(folder, 7, capture), range(40)))
    assert CampaignFolder(folder).keys()[-1] == ("v1", 5)
    assert not list((folder / "captures").glob(".*"))


def test_another_capture_of_the_same_number_is_refused(folder, make_capture):
    with pytest.raises(FileError, match="000001 was not written: File exists"):
        write_numbered_capture(folder, 1, make_capture(5.0))


def test_name_sensor_and_part_are_kept(folder, sensor, part):
    campaign: CaptureSource = CampaignFolder(folder)
    assert campaign.name == "door"
    assert len(campaign) == 3
    assert campaign.sensor.cameras == sensor.cameras
    assert campaign.part.name == part.name
    assert [f.name for f in campaign.part.features] == [f.name for f in part.features]


def test_keys_are_known_without_reading_images(folder):
    for image in folder.glob("captures/*/image.png"):
        image.unlink()
    assert CampaignFolder(folder).keys() == (("v1", 30), ("v1", 10), ("v1", 20))


def test_captures_are_read_one_at_a_time(folder):
    captures = CampaignFolder(folder).captures()
    next(captures)
    shutil.rmtree(folder / "captures" / "000002")
    assert next(captures).exposure_ms == 10
    with pytest.raises(MissingFileError, match=r"no file of a campaign at .*000002/capture\.json"):
        next(captures)


def test_missing_points_cost_a_bit_each(tmp_path, sensor, part, make_capture):
    with reopen(tmp_path, sensor, part) as writer:
        writer.add(make_capture())
    with np.load(tmp_path / "captures" / "000000" / "cloud.npz") as arrays:
        assert arrays["shape"].tolist() == [12, 16]
        assert arrays["valid"].shape == (24,)
        assert arrays["points"].shape == (make_capture().cloud.n_valid, 3)


# -- going on -----------------------------------------------------------------------------------


def test_a_reopened_writer_knows_what_is_there(folder, sensor, part):
    with reopen(folder, sensor, part) as writer:
        assert list(writer.keys.values()) == [("v1", 30), ("v1", 10), ("v1", 20)]
        assert writer.has("v1", 10)
        assert not writer.has("v2", 10)


def test_a_reopened_writer_adds_behind_what_is_there(folder, sensor, part, make_capture):
    with reopen(folder, sensor, part) as writer:
        writer.add(make_capture(5.0))
    assert [c.exposure_ms for c in CampaignFolder(folder).captures()] == [30, 10, 20, 5]


def test_a_reopened_writer_knows_the_number_of_each_capture(folder, sensor, part):
    shutil.rmtree(folder / "captures" / "000001")
    with reopen(folder, sensor, part) as writer:
        assert writer.keys == {0: ("v1", 30), 2: ("v1", 20)}


def test_numbered_captures_come_in_the_order_of_their_numbers(folder, sensor, part, make_capture):
    with reopen(folder, sensor, part):
        for number, exposure in ((7, 5.0), (4, 6.0)):
            write_numbered_capture(folder, number, make_capture(exposure))
    captures = list(CampaignFolder(folder).captures())
    assert [capture.exposure_ms for capture in captures] == [30, 10, 20, 6, 5]
    assert_same(captures[-1], make_capture(5.0))


def test_a_number_that_is_there_is_refused_and_its_capture_kept(folder, sensor, part, make_capture):
    with (
        reopen(folder, sensor, part),
        pytest.raises(FileError, match="000001 was not written: File exists"),
    ):
        write_numbered_capture(folder, 1, make_capture(5.0))
    assert [capture.exposure_ms for capture in CampaignFolder(folder).captures()] == [30, 10, 20]


def test_a_writer_adds_behind_the_numbers_there_when_it_was_opened(
    folder, sensor, part, make_capture
):
    write_numbered_capture(folder, 41, make_capture(5.0))
    with reopen(folder, sensor, part) as writer:
        writer.add(make_capture(6.0))
    assert CampaignFolder(folder).numbers == (0, 1, 2, 41, 42)


def test_a_deleted_capture_can_be_taken_again(folder, sensor, part, make_capture):
    shutil.rmtree(folder / "captures" / "000001")
    with reopen(folder, sensor, part) as writer:
        assert not writer.has("v1", 10)
        writer.add(make_capture(10.0))
    assert [c.exposure_ms for c in CampaignFolder(folder).captures()] == [30, 20, 10]


def test_the_same_view_and_exposure_twice_is_refused(folder, sensor, part, make_capture):
    with (
        reopen(folder, sensor, part) as writer,
        pytest.raises(InputError, match="already has a capture of view 'v1' at 10 ms"),
    ):
        writer.add(make_capture(10.0))


def test_a_capture_of_another_sensor_is_refused(folder, sensor, part, make_capture):
    wrong = replace(make_capture(5.0), image=np.zeros((5, 5), np.uint8))
    with reopen(folder, sensor, part) as writer, pytest.raises(ImageError, match="got 5 × 5"):
        writer.add(wrong)
    assert len(CampaignFolder(folder)) == 3


def test_another_sensor_is_refused(folder, sensor, part):
    longer = replace(sensor, exposure=replace(sensor.exposure, max_ms=2000.0))
    with pytest.raises(InputError, match=r"sensor 'small' that differs.*choose another folder"):
        reopen(folder, longer, part)


def test_another_part_is_refused(folder, sensor, part):
    one = part.features[0]
    wider = Feature(
        name=one.name, kind="hole", part_from_feature=one.part_from_feature, radius_mm=5.5
    )
    other = Part(name=part.name, features=(wider, *part.features[1:]))
    with pytest.raises(InputError, match="is of a part 'sheet' that differs"):
        reopen(folder, sensor, other)


def test_another_name_is_refused(folder, sensor, part):
    with pytest.raises(InputError, match="is called 'door' and not 'roof'"):
        reopen(folder, sensor, part, name="roof")


def test_the_sensor_and_part_that_were_read_are_the_same(folder):
    campaign = CampaignFolder(folder)
    reopen(folder, campaign.sensor, campaign.part).close()


def test_a_folder_with_something_else_in_it_is_refused(tmp_path, sensor, part):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(FormatError, match=r"holds thesis\.tex and no campaign\.json"):
        reopen(tmp_path, sensor, part)
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


def test_captures_without_a_description_are_not_taken_over(folder, sensor, part):
    (folder / "campaign.json").unlink()
    with pytest.raises(FormatError, match=r"holds 00000\d and no campaign\.json"):
        reopen(folder, sensor, part)


def test_two_writers_at_once_are_refused(folder, sensor, part):
    with (
        reopen(folder, sensor, part),
        pytest.raises(FileError, match=r"another writer has the campaign in .*campaign open"),
    ):
        reopen(folder, sensor, part)


def test_a_disk_without_locks_is_refused(folder, sensor, part, monkeypatch):
    def no_locks(_descriptor, _operation):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", no_locks)
    with pytest.raises(FileError, match=r"writer\.lock cannot be locked .*to a local disk"):
        reopen(folder, sensor, part)


def test_a_file_that_cannot_be_read_is_named(folder):
    image = folder / "captures" / "000001" / "image.png"
    image.unlink()
    image.mkdir()
    with pytest.raises(FileError, match=r"image\.png cannot be read: Is a directory"):
        read_all(folder)


def test_a_forgotten_writer_lets_the_next_one_in(folder, sensor, part):
    writer = reopen(folder, sensor, part)
    del writer
    reopen(folder, sensor, part).close()


def test_a_closed_writer_adds_nothing(folder, sensor, part, make_capture):
    writer = reopen(folder, sensor, part)
    writer.close()
    writer.close()
    with pytest.raises(FileError, match=r"the writer of .* is closed"):
        writer.add(make_capture(5.0))


def test_a_full_disk_is_said_and_what_was_captured_stays(
    folder, sensor, part, make_capture, monkeypatch
):
    def no_space(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with reopen(folder, sensor, part) as writer:
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", no_space)
            with pytest.raises(FileError, match="000003 was not written: the disk is full"):
                writer.add(make_capture(5.0))
        assert len(list(CampaignFolder(folder).captures())) == 3
        assert len(list((folder / "captures").iterdir())) == 3
        writer.add(make_capture(5.0))
    assert len(list(CampaignFolder(folder).captures())) == 4


# -- what is damaged, missing or newer ----------------------------------------------------------

FILES = [
    "campaign.json",
    "sensor.json",
    "features.csv",
    "captures/000001/capture.json",
    "captures/000001/image.png",
    "captures/000001/cloud.npz",
]


def read_all(folder):
    return list(CampaignFolder(folder).captures())


@pytest.mark.parametrize("name", FILES)
def test_a_flipped_bit_anywhere_is_found_and_the_file_named(folder, name):
    path = folder / name
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(DamagedFileError, match=name.replace(".", r"\.") + " is damaged"):
        read_all(folder)


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_cut_off_is_found(folder, name):
    path = folder / name
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(DamagedFileError, match=name.replace(".", r"\.")):
        read_all(folder)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(MissingFileError, match=name.rsplit("/", maxsplit=1)[-1]):
        read_all(folder)


@pytest.mark.parametrize("name", ["campaign.json", "captures/000001/capture.json"])
def test_a_newer_version_is_refused(folder, name):
    document = json.loads((folder / name).read_text())
    document["version"] = 99
    document["something new"] = {}
    (folder / name).write_text(json.dumps(document))
    with pytest.raises(VersionError, match=f"{name} has version 99 .* update exposight"):
        read_all(folder)


def reseal(path, **changes):
    """Change a description and its checksum, as another program could."""
    document = {**json.loads(path.read_text()), **changes}
    del document["sha256"]
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(json.dumps({**document, "sha256": sha256}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"exposure_ms": -1.0}, r"000001: an exposure time must be above 0 ms, got -1\.0 ms"),
        (
            {"exposure_ms": "10"},
            r"capture\.json: key 'exposure_ms': expected a number, got the text \"10\"",
        ),
        ({"gain": 1}, r"capture\.json: key 'gain' is unknown"),
        ({"bit_depth": 16}, r"000001: image: expected 16 bits in uint16, got uint8"),
    ],
)
def test_a_description_that_another_program_wrote_wrongly_is_refused(folder, changes, message):
    reseal(folder / "captures" / "000001" / "capture.json", **changes)
    with pytest.raises(FormatError, match=message):
        read_all(folder)


@pytest.mark.parametrize(
    ("name", "key", "message"),
    [
        ("image.png", "image_sha256", "no PNG image"),
        ("cloud.npz", "cloud_sha256", "not a readable cloud of a"),
    ],
)
def test_a_file_that_another_program_wrote_wrongly_is_refused(folder, name, key, message):
    capture = folder / "captures" / "000001"
    (capture / name).write_bytes(b"a photograph")
    reseal(capture / "capture.json", **{key: hashlib.sha256(b"a photograph").hexdigest()})
    with pytest.raises(FormatError, match=f"{name} is {message}"):
        read_all(folder)


def test_layout_and_order_of_a_description_do_not_matter(folder):
    path = folder / "campaign.json"
    document = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(document.items()))))
    assert len(read_all(folder)) == 3


def test_the_other_captures_of_a_damaged_campaign_are_readable(folder):
    (folder / "captures" / "000002" / "image.png").write_bytes(b"")
    captures = CampaignFolder(folder).captures()
    assert [next(captures).exposure_ms for _ in range(2)] == [30, 10]


def test_no_folder_is_no_campaign(tmp_path):
    with pytest.raises(MissingFileError, match=r"no campaign at .*gone: expected a folder with"):
        CampaignFolder(tmp_path / "gone")


def test_any_folder_is_no_campaign(tmp_path):
    with pytest.raises(MissingFileError, match=r"no campaign at .*: expected a folder with"):
        CampaignFolder(tmp_path)


# -- in memory ----------------------------------------------------------------------------------


@pytest.fixture
def in_memory(sensor, part, make_capture) -> MemoryCampaign:
    captures = [make_capture(20.0), make_capture(10.0), make_capture(10.0, view="v2")]
    return MemoryCampaign(name="door", sensor=sensor, part=part, captures=captures)


def test_captures_come_in_the_order_they_were_given_every_time(in_memory):
    expected = [("v1", 20.0), ("v1", 10.0), ("v2", 10.0)]
    assert [capture.key for capture in in_memory.captures()] == expected
    assert [capture.key for capture in in_memory.captures()] == expected
    assert len(in_memory) == 3


def test_a_campaign_in_memory_is_a_campaign(in_memory):
    def name_of(some: CaptureSource) -> str:
        return some.name

    assert name_of(in_memory) == "door"


def test_the_same_capture_twice_is_refused_in_memory(sensor, part, make_capture):
    with pytest.raises(InputError, match="'door' already has a capture of view 'v1' at 10 ms"):
        MemoryCampaign(
            name="door", sensor=sensor, part=part, captures=[make_capture(), make_capture()]
        )


def test_a_capture_of_another_sensor_is_refused_in_memory(sensor, part, make_capture):
    wrong = replace(make_capture(), image=np.zeros((5, 5), np.uint8))
    with pytest.raises(ImageError, match="sensor 'small' takes images of 12 rows"):
        MemoryCampaign(name="door", sensor=sensor, part=part, captures=[wrong])
