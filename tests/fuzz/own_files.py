"""Files that exposight writes itself: sensors, campaigns, and what lies in a capture's folder.

A campaign's files are held by checksums in others of its files, so a reader of mutants of one puts
it into a campaign and makes the checksums right again: what lies behind them is tried.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from tests.cell.conftest import COLUMNS, ROWS, small_capture, small_part, small_sensor
from tests.fuzz.formats import Format, Sample

from exposight.cell import (
    ActiveSensor,
    CampaignFolder,
    CampaignWriter,
    Capture,
    Cloud,
    MemoryCampaign,
    StackImages,
    read_sensor,
    sensor_preset,
)
from exposight.cell.feature_lists.feature_files import features_to_csv
from exposight.geometry import RigidTransform


def canonical(content: dict[str, Any]) -> str:
    """Return the checksum of a document, as it is sealed with."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def reseal_document(_whole: bytes, data: bytes) -> bytes:
    """Return a document whose checksum of itself is right again."""
    content = json.loads(data)
    content.pop("sha256", None)
    return json.dumps({**content, "sha256": canonical(content)}, indent=2).encode()


def key_twice(data: bytes, random: Random) -> bytes | None:
    """Write a key of some object twice, with another value: which is meant?"""
    text = data.decode()
    places = [at for at in range(len(text)) if text.startswith('": ', at)]
    if not places:
        return None
    at = random.choice(places)
    begin = text.rindex('"', 0, at)
    key = text[begin : at + 1]
    return (text[:begin] + f"{key}: 7, " + text[begin:]).encode()


def quoted_number(data: bytes, random: Random) -> bytes | None:
    """Put a number in quotation marks."""
    lines = data.decode().split("\n")
    places = [
        i for i, line in enumerate(lines) if line.strip().strip(",").lstrip("-")[:1].isdigit()
    ]
    if not places:
        return None
    at = random.choice(places)
    bare = lines[at].strip().rstrip(",")
    lines[at] = lines[at].replace(bare, f'"{bare}"')
    return "\n".join(lines).encode()


JSON_FAULTS = {"a key twice": key_twice, "a number in quotes": quoted_number}


# -- sensors --------------------------------------------------------------------------------------


def _sensors(folder: Path) -> list[Sample]:
    simulated = folder / "simulated.json"
    sensor = json.loads(sensor_preset("comet-pro-ae").to_json())
    simulated.write_text(
        json.dumps({**sensor, "version": 2, "simulated": {"noise": 1.5, "of": [1, {"a": 2}]}})
    )
    small = folder / "small.json"
    small.write_text(small_sensor("Ärger").to_json())
    stereo = folder / "sensor.json"
    stereo.write_text(sensor_preset("rc-visard-65").to_json())
    return [Sample(stereo), Sample(simulated), Sample(small)]


def sensor_is_wrong(sensor: ActiveSensor) -> str:
    """Say what no sensor may be."""
    again = ActiveSensor.from_json(sensor.to_json())
    if json.loads(again.to_json()).keys() != json.loads(sensor.to_json()).keys():
        return "written and read again it has other keys"
    if again.name != sensor.name or again.exposure != sensor.exposure:
        return "written and read again it is another"
    cameras = [*sensor.cameras, *([sensor.projector.camera] if sensor.projector else [])]
    for camera in cameras:
        if camera.width < 1 or camera.height < 1 or camera.width * camera.height > 10**9:
            return f"a camera of {camera.width} × {camera.height}"
        numbers = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion)
        if not np.isfinite(numbers).all() or camera.fx <= 0 or camera.fy <= 0:
            return f"a camera of {numbers}"
    for pose in (*sensor.first_from_camera, sensor.camera_from_tcp):
        if why := pose_is_wrong(pose):
            return why
    return ""


def pose_is_wrong(pose: RigidTransform) -> str:
    """Say what no pose may be."""
    matrix = pose.to_matrix()
    if not np.isfinite(matrix).all():
        return "a pose that is not finite"
    if not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-6):
        return "a pose that is not rigid"
    return ""


# -- campaigns ------------------------------------------------------------------------------------


def _captures() -> list[Capture]:
    plain = small_capture(10.0, "v1")
    rng = np.random.default_rng(0)

    def image(high: int = 256, kind: type = np.uint8) -> Any:
        return rng.integers(0, high, (ROWS, COLUMNS)).astype(kind)

    stacked = Capture(
        view="v1",
        exposure_ms=20.0,
        image=image(1024, np.uint16),
        bit_depth=10,
        cloud=Cloud(
            points=plain.require_cloud().points, sigma_z_mm=np.full((ROWS, COLUMNS), 0.125)
        ),
        camera_from_part=plain.camera_from_part,
        stack=StackImages(
            mean=image(1024, np.uint16),
            maximum=image(1024, np.uint16),
            modulation=image(1024, np.uint16),
            min_modulation=7.5,
        ),
        attachments={"notes.txt": b"frame 1", "raw.bin": bytes(range(20))},
    )
    free = Capture(
        view="v2",
        exposure_ms=5.5,
        image=image(),
        cloud=Cloud(points=plain.require_cloud().valid_points[:20]),
        camera_from_part=plain.camera_from_part,
        brightness_source="texture",
    )
    bare = Capture(
        view="v2",
        exposure_ms=7.0,
        image=image(),
        cloud=None,
        camera_from_part=plain.camera_from_part,
        emulated=True,
    )
    return [plain, stacked, free, bare]


@cache
def _written() -> dict[str, bytes]:
    """Return the files of a campaign by their paths within it."""
    with tempfile.TemporaryDirectory() as folder:
        sensor, part = small_sensor(), small_part()
        with CampaignWriter.open_or_create(
            Path(folder) / "c", name="few", sensor=sensor, part=part
        ) as writer:
            for capture in _captures():
                writer.add(capture)
        root = Path(folder) / "c"
        return {
            path.relative_to(root).as_posix(): path.read_bytes()
            for path in sorted(root.rglob("*"))
            if path.is_file() and path.name != "writer.lock"
        }


def _campaign(folder: Path) -> Path:
    for name, content in _written().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def _samples_of(*names: str) -> Callable[[Path], list[Sample]]:
    """Return what writes a campaign whose files of these names are mutated in it."""

    def samples(folder: Path) -> list[Sample]:
        root = _campaign(folder)
        return [Sample(root / name, root) for name in names]

    return samples


Read = tuple[CampaignFolder, list[Capture], list[dict[str, bytes]]]


def _read(path: Path) -> Read:
    campaign = CampaignFolder(path)
    captures = list(campaign.captures())
    return campaign, captures, [dict(capture.attachments) for capture in captures]


def _told(read: Read) -> str:
    """Return all that was read as a text, of arrays their checksums."""
    campaign, captures, attachments = read
    said: list[object] = [campaign.name, campaign.sensor.to_json(), campaign.part.name]
    said.append(features_to_csv(campaign.part.features))
    for capture, beside in zip(captures, attachments, strict=True):
        stack = {} if capture.stack is None else capture.stack.images()
        arrays = [capture.image, *stack.values()]
        if capture.cloud is not None:
            arrays.append(capture.cloud.points)
            if capture.cloud.sigma_z_mm is not None:
                arrays.append(capture.cloud.sigma_z_mm)
        said += [hashlib.sha256(np.ascontiguousarray(each)).hexdigest() for each in arrays]
        said += [capture.key, capture.bit_depth, capture.emulated, capture.notes, beside]
        said += [capture.camera_from_part.to_matrix().tolist(), capture.brightness_source]
        said += [capture.stack and capture.stack.min_modulation]
    return repr(said)


def _same(one: Read, other: Read) -> bool:
    return _told(one) == _told(other)


def _campaign_is_wrong(read: Read) -> str:
    campaign, captures, attachments = read
    try:
        MemoryCampaign(
            name=campaign.name, sensor=campaign.sensor, part=campaign.part, captures=captures
        )
    except Exception as error:
        return f"what the writer refuses: {type(error).__name__}: {error}"
    for capture, beside in zip(captures, attachments, strict=True):
        if why := pose_is_wrong(capture.camera_from_part):
            return why
        try:
            Capture(**{**vars(capture), "attachments": beside})
        except Exception as error:
            return f"what no capture may be: {type(error).__name__}: {error}"
        cloud = capture.cloud
        if cloud is not None and cloud.organised and cloud.valid.shape != capture.image.shape:
            rows, columns = capture.image.shape
            if rows % cloud.valid.shape[0] or columns % cloud.valid.shape[1]:
                return f"a cloud of {cloud.valid.shape} beside an image of {capture.image.shape}"
    return sensor_is_wrong(campaign.sensor)


# -- files whose checksums lie in others ----------------------------------------------------------

_HOLDERS = {
    "sensor.json": ("campaign.json", ("sensor_sha256",)),
    "features.csv": ("campaign.json", ("features_sha256",)),
    "image.png": ("capture.json", ("image_sha256",)),
    "cloud.npz": ("capture.json", ("cloud_sha256",)),
    "notes.txt": ("capture.json", ("beside_sha256", "notes.txt")),
    **{
        f"{name}.png": ("capture.json", ("stack", f"{name}_sha256"))
        for name in ("mean", "maximum", "modulation")
    },
}


def put_in(root: Path, name: str, data: bytes) -> Path:
    """Put a file into a campaign, and make the checksums above it right; return the campaign."""
    path = root / name
    path.write_bytes(data)
    holder_name, keys = _HOLDERS[path.name]
    holder = path.with_name(holder_name)
    content = json.loads(holder.read_bytes())
    table = content
    for key in keys[:-1]:
        table = table[key]
    table[keys[-1]] = hashlib.sha256(data).hexdigest()
    holder.write_bytes(reseal_document(b"", json.dumps(content).encode()))
    return root


def _alone(*names: str) -> tuple[Callable[[Path], list[Sample]], Callable[[Path], Read]]:
    """Return samples of a campaign's files, lying alone, and what reads each in its campaign."""

    def samples(folder: Path) -> list[Sample]:
        found = []
        for number, name in enumerate(names):
            root = folder / f"{number}"
            _campaign(root / "campaign")
            file = root / "alone"
            file.write_bytes(_written()[name])
            (root / "name").write_text(name)
            found.append(Sample(file))
        return found

    def read(path: Path) -> Read:
        name = path.with_name("name").read_text()
        return _read(put_in(path.with_name("campaign"), name, path.read_bytes()))

    return samples, read


def _of_campaign(name: str, *files: str, text: bool, **more: Any) -> Format:
    samples, read = _alone(*files)
    return Format(name, samples, read, wrong=_campaign_is_wrong, same=_same, text=text, **more)


_FIRST, _STACKED, _FREE = (f"captures/{number:06d}" for number in range(3))

FORMATS = (
    Format("sensor JSON", _sensors, read_sensor, wrong=sensor_is_wrong, faults=JSON_FAULTS),
    Format(
        "campaign.json",
        _samples_of("campaign.json"),
        _read,
        wrong=_campaign_is_wrong,
        faults=JSON_FAULTS,
        sealed=True,
        reseal=reseal_document,
        same=_same,
    ),
    Format(
        "capture.json",
        _samples_of(*(f"captures/{number:06d}/capture.json" for number in range(4))),
        _read,
        wrong=_campaign_is_wrong,
        faults=JSON_FAULTS,
        sealed=True,
        reseal=reseal_document,
        same=_same,
    ),
    Format(
        "files of a capture",
        _samples_of(
            *(f"{_STACKED}/{name}" for name in ("image.png", "mean.png", "cloud.npz", "raw.bin"))
        ),
        _read,
        wrong=_campaign_is_wrong,
        sealed=True,
        same=_same,
        text=False,
    ),
    _of_campaign("sensor of a campaign", "sensor.json", text=True, faults=JSON_FAULTS),
    _of_campaign("features of a campaign", "features.csv", text=True),
    _of_campaign("image of a capture", f"{_FIRST}/image.png", f"{_STACKED}/image.png", text=False),
    _of_campaign(
        "stack images of a capture",
        *(f"{_STACKED}/{name}.png" for name in ("mean", "maximum", "modulation")),
        text=False,
    ),
    _of_campaign(
        "cloud of a capture",
        *(f"{each}/cloud.npz" for each in (_FIRST, _STACKED, _FREE)),
        text=True,
    ),
)
