"""A flat plate of twelve holes, seen from three heights at six exposures, as a small campaign."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from exposight.cell import (
    ActiveSensor,
    CampaignWriter,
    Capture,
    Cloud,
    ExposureRange,
    Feature,
    Part,
    write_cloud,
    write_features,
    write_sensor,
)
from exposight.geometry import PinholeCamera, RigidTransform

HEIGHTS_MM = (560.0, 600.0, 640.0)
EXPOSURES_MS = (1.0, 3.0, 6.0, 10.0, 16.0, 40.0)
ROWS, COLUMNS = 180, 240


def plate_sensor() -> ActiveSensor:
    camera = PinholeCamera(width=COLUMNS, height=ROWS, fx=300.0, fy=300.0, cx=119.5, cy=89.5)
    return ActiveSensor(
        name="small",
        cameras=(camera,),
        first_from_camera=(RigidTransform(),),
        projector=None,
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, 600.0])),
        exposure=ExposureRange(min_ms=0.5, max_ms=50.0, increment_ms=0.5),
        working_distance_mm=(400.0, 800.0),
    )


def plate() -> Part:
    places = [(x, y) for y in (-60.0, 0.0, 60.0) for x in (-150.0, -50.0, 50.0, 150.0)]
    features = [
        Feature(
            name=f"h{number:02d}",
            kind="hole",
            part_from_feature=RigidTransform(translation_mm=np.array([x, y, 0.0])),
            radius_mm=5.0,
        )
        for number, (x, y) in enumerate(places, start=1)
    ]
    aside = RigidTransform(translation_mm=np.array([900.0, 0.0, 0.0]))
    features.append(Feature(name="far", kind="hole", part_from_feature=aside, radius_mm=5.0))
    return Part(name="plate", features=tuple(features))


def plate_capture(height_mm: float, exposure_ms: float) -> Capture:
    """The plate square to the camera, brighter in its middle; no point where dark or clipped."""
    rng = np.random.default_rng(round(height_mm + 1000 * exposure_ms))
    v, u = np.mgrid[0:ROWS, 0:COLUMNS]
    x, y = (u - 119.5) / 300.0, (v - 89.5) / 300.0
    light = (600.0 / height_mm) ** 2 / (1.0 + x**2 + y**2) ** 2
    grey = np.clip(12.0 * exposure_ms * light + rng.normal(0.0, 2.0, x.shape), 0, 255)
    points = np.stack([x, y, np.ones_like(x)], axis=-1) * height_mm
    points[(grey < 20) | (grey > 250)] = np.nan
    return Capture(
        view=f"z{height_mm:.0f}",
        exposure_ms=exposure_ms,
        image=grey.astype(np.uint8),
        cloud=Cloud(points=points),
        camera_from_part=RigidTransform(translation_mm=np.array([0.0, 0.0, height_mm])),
    )


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign") / "plate"
    with CampaignWriter.open_or_create(
        folder, name="plate", sensor=plate_sensor(), part=plate()
    ) as writer:
        for height_mm in HEIGHTS_MM:
            for exposure_ms in EXPOSURES_MS:
                writer.add(plate_capture(height_mm, exposure_ms))
    return folder


@pytest.fixture(scope="session")
def single(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of one capture, as a metrologist has them."""
    folder = tmp_path_factory.mktemp("single")
    capture = plate_capture(600.0, 10.0)
    cv2.imwrite(str(folder / "stripes.png"), np.asarray(capture.image))
    write_cloud(folder / "cloud.ply", capture.cloud)
    write_features(folder / "features.csv", plate().features)
    write_sensor(folder / "sensor.json", plate_sensor())
    pose = "1 0 0 0\n0 1 0 0\n0 0 1 600\n0 0 0 1\n"
    (folder / "pose.txt").write_text(pose, encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def observations(campaign: Path, run_json: Callable[..., Any]) -> Path:
    path = campaign.parent / "observations.csv"
    run_json("observe", campaign, "-o", path)
    return path


@pytest.fixture(scope="session")
def models(campaign: Path, observations: Path, run_json: Callable[..., Any]) -> Path:
    folder = campaign.parent / "models"
    run_json(
        *("train", observations, "-m", "q_k4", "-m", "e_k4", "-o", folder, "--workers", 1),
        *("--sensor", campaign / "sensor.json", "--restarts", 1),
    )
    return folder
