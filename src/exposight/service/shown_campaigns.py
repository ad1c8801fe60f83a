"""What clients are shown of campaigns and their captures, as JSON has it; captures never change."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from exposight.cell import CampaignFolder
from exposight.cell.capture import CaptureDescription, read_capture, read_description
from exposight.cell.image import GREY_MAX, full_scale
from exposight.cell.image_files import decoded_image
from exposight.errors import ExposightError, ImageError, MissingFileError
from exposight.files import read_verified
from exposight.geometry import StackedPoses, outlines_in_camera
from exposight.measuring.view_work import OBSERVATIONS_FILE, stored_observations
from exposight.observing import Observer, View, Visibility

_IMAGE = "image.png"
_JPEG_QUALITY = 85
_OUTLINE = 32
"""Points of a ring's outline, at most."""


def capture_folder(campaign: CampaignFolder, number: int) -> Path:
    """Return the folder of one of a campaign's captures.

    Raises
    ------
    MissingFileError
        If it has none of this number.
    """
    folder = campaign.path / "captures" / f"{number:06d}"
    if number not in campaign.numbers:
        msg = f"campaign {campaign.name!r} has no capture {number}; it has {len(campaign)}"
        raise MissingFileError(msg)
    return folder


def description(campaign: CampaignFolder, number: int) -> CaptureDescription:
    """Return what is known of a capture without its image and cloud; read once.

    Raises
    ------
    FileError
        If it is not there, or damaged.
    """
    folder = capture_folder(campaign, number)
    try:
        changed = (folder / "capture.json").stat().st_mtime_ns
    except OSError as error:
        msg = f"campaign {campaign.name!r} has no capture {number} any more"
        raise MissingFileError(msg) from error
    return _description(folder, changed)


@lru_cache(maxsize=20_000)
def _description(folder: Path, _changed: int) -> CaptureDescription:
    return read_description(folder)


def summary(name: str, campaign: CampaignFolder) -> dict[str, Any]:
    """Return what a campaign is of: part, sensor, views, exposure times."""
    captures = [description(campaign, number) for number in campaign.numbers]
    return {
        "name": name,
        "part": campaign.part.name,
        "sensor": campaign.sensor.name,
        "n_captures": len(captures),
        "views": list(dict.fromkeys(each.view for each in captures)),
        "exposures_ms": sorted({each.exposure_ms for each in captures}),
    }


def features(campaign: CampaignFolder) -> list[dict[str, Any]]:
    """Return a campaign's features: kind, size in mm, place and outward normal in the part."""
    return [
        {
            "name": each.name,
            "kind": each.kind,
            "finish": each.finish or None,
            "radius_mm": each.radius_mm,
            "position_mm": each.part_from_feature.translation_mm.tolist(),
            "normal": (0.0 - each.part_from_feature.z_axis).tolist(),
        }
        for each in campaign.part.features
    ]


def captures(campaign: CampaignFolder) -> list[dict[str, Any]]:
    """Return a campaign's captures: number, view, exposure time, pose as a 4 × 4 matrix in mm."""
    rows = []
    for number in campaign.numbers:
        each = description(campaign, number)
        rows.append(
            {
                "number": number,
                "view": each.view,
                "exposure_ms": each.exposure_ms,
                "camera_from_part": each.camera_from_part.to_matrix().tolist(),
            }
        )
    return rows


def image(campaign: CampaignFolder, number: int, width: int | None) -> tuple[bytes, str]:
    """Return a capture's image as it was kept, or downscaled, and its media type.

    Parameters
    ----------
    campaign, number
        The capture.
    width : int or None, px
        Images that are wider are scaled to this width, and to 8 bits; None leaves them.

    Raises
    ------
    FileError, ImageError
        If it cannot be read.
    """
    about, folder = description(campaign, number), capture_folder(campaign, number)
    if width is None or width >= campaign.sensor.camera.width:
        return read_verified(folder / _IMAGE, about.image_sha256, "image"), "image/png"
    return _scaled(folder, about.image_sha256, about.bit_depth, width), "image/jpeg"


@lru_cache(maxsize=128)
def _scaled(folder: Path, sha256: str, bit_depth: int, width: int) -> bytes:
    path = folder / _IMAGE
    pixels = decoded_image(read_verified(path, sha256, "image"), path)
    factor = width / pixels.shape[1]
    height = max(1, round(pixels.shape[0] * factor))
    small = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
    grey = np.rint(small * (GREY_MAX / full_scale(bit_depth))).astype(np.uint8)
    done, data = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not done:
        msg = f"{path} could not be encoded as JPEG"
        raise ImageError(msg)
    return bytes(data)


def rings(campaign: CampaignFolder, number: int) -> dict[str, Any]:
    """Return where a capture's image has the features' rings, and how they were measured.

    Raises
    ------
    FileError
        If the capture cannot be read.
    """
    about, folder = description(campaign, number), capture_folder(campaign, number)
    seen = View.of(campaign.part, campaign.sensor, about.camera_from_part)
    regions = [each.region for each in seen.features]
    poses = StackedPoses.of([each.camera_from_feature for each in seen.features])
    camera = campaign.sensor.camera
    outlines = camera.project(outlines_in_camera(regions, poses))
    step = -(-outlines.shape[1] // _OUTLINE)
    outlines = np.round(outlines[:, ::step], 1)
    p_norm = _p_norm(folder, about.image_sha256, campaign, number)
    return {
        "width": camera.width,
        "height": camera.height,
        "rings": [
            {
                "feature": each.feature.name,
                "outline": _shown_outline(each.visibility, outline),
                "p_norm": p_norm.get(each.feature.name),
                "status": each.visibility.value,
            }
            for each, outline in zip(seen.features, outlines, strict=True)
        ],
    }


def _shown_outline(visibility: Visibility, outline: np.ndarray[Any, Any]) -> list[list[float]]:
    shown = visibility in {Visibility.VISIBLE, Visibility.PARTLY_OUT_OF_FRAME}
    return outline.tolist() if shown and np.isfinite(outline).all() else []


_measured: dict[tuple[Path, str], dict[str, float | None]] = {}
_MOST_MEASURED = 4096


def _p_norm(
    folder: Path, sha256: str, campaign: CampaignFolder, number: int
) -> dict[str, float | None]:
    """Return each feature's p_norm in a capture, kept with it or counted now; empty without any."""
    key = folder, sha256
    if key not in _measured:
        if len(_measured) >= _MOST_MEASURED:
            _measured.clear()
        _measured[key] = _counted(folder, campaign, number)
    return _measured[key]


def _counted(folder: Path, campaign: CampaignFolder, number: int) -> dict[str, float | None]:
    about = description(campaign, number)
    if OBSERVATIONS_FILE in about.beside_sha256:
        frame = stored_observations(campaign, number, about).frame
        return dict(zip(frame["feature"], frame["p_norm"], strict=True))
    if about.cloud_sha256 is None:
        return {}
    try:
        capture = read_capture(folder, campaign.sensor)
        rows = Observer(campaign.part, campaign.sensor).observe(capture)
    except ExposightError:  # such as points that contradict the image: nothing is known then
        return {}
    return {each.feature: each.p_norm for each in rows}
