"""A served folder: a small plate, its campaign, models, plan, list of features and sensor."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("fastapi", reason="the extra 'service' is not installed")
pytest.importorskip("httpx", reason="the extra 'service' is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # newer ones want another client's name
    warnings.simplefilter("ignore", UserWarning)
    from fastapi.testclient import TestClient

from tests.measuring.conftest import PlateDriver, plate_exposure_plan
from tests.service.run_cases import captured

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
from exposight.measuring import measure, measure_adaptively
from exposight.observing import observe_campaign, open_campaign
from exposight.planning import plan, train, write_exposure_plan
from exposight.plans import read_plan, write_plan
from exposight.service.app import create_app
from exposight.service.guard import Limits
from exposight.twin import SimulatedCell

ROWS, COLUMNS = 180, 240
VIEWS = {
    f"v{number}": (height_mm, w_deg, p_deg)
    for number, (height_mm, w_deg, p_deg) in enumerate(
        [(560, 0, 0), (600, 8, 0), (640, 0, 8), (600, -8, -8), (580, 5, -5), (630, -5, 5)], start=1
    )
}
EXPOSURES_MS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)


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


def plate_part() -> Part:
    places = [(x, y) for y in (-55.0, 0.0, 55.0) for x in (-140.0, -50.0, 50.0, 140.0)]
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
    features.append(Feature(name="aside", kind="hole", part_from_feature=aside, radius_mm=5.0))
    return Part(name="plate", features=tuple(features))


def plate_pose(view: str) -> RigidTransform:
    height_mm, w_deg, p_deg = VIEWS[view]
    return RigidTransform.from_fanuc_wpr((0.0, 0.0, float(height_mm)), w_deg, p_deg, 0.0)


def plate_capture(
    view: str, exposure_ms: float, pose: RigidTransform | None = None, light: float = 1.0
) -> Capture:
    """The plate, brighter in the left half; no point where dark or clipped."""
    pose = pose or plate_pose(view)
    v, u = np.mgrid[0:ROWS, 0:COLUMNS]
    rays = np.stack([(u - 119.5) / 300.0, (v - 89.5) / 300.0, np.ones(u.shape)], axis=-1)
    normal, origin = pose.to_matrix()[:3, 2], pose.translation_mm
    distance = (normal @ origin) / (rays @ normal)
    points = rays * distance[..., None]
    local = (600.0 / points[..., 2]) ** 2 * np.where(u < 120, 2.0, 1.0)
    rng = np.random.default_rng(round(1000 * exposure_ms) + sum(map(ord, view)))
    grey = np.clip(12.0 * light * exposure_ms * local + rng.normal(0.0, 1.0, u.shape), 0, 255)
    points[(grey < 20) | (grey > 250)] = np.nan
    return Capture(
        view=view,
        exposure_ms=exposure_ms,
        image=np.rint(grey).astype(np.uint8),
        cloud=Cloud(points=points),
        camera_from_part=pose,
    )


@pytest.fixture(scope="session")
def capture_of() -> Callable[..., Capture]:
    """Return what captures the plate (`plate_capture`)."""
    return plate_capture


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The served folder, which tests copy where they write in it."""
    folder = tmp_path_factory.mktemp("served")
    sensor, part = plate_sensor(), plate_part()
    with CampaignWriter.open_or_create(
        folder / "campaign", name="plate", sensor=sensor, part=part
    ) as writer:
        for view in VIEWS:
            for exposure_ms in EXPOSURES_MS:
                writer.add(plate_capture(view, exposure_ms))
    table = observe_campaign(open_campaign(folder / "campaign"))
    models = train(table, sensor=sensor)
    models.save(folder / "models")
    views = {name: plate_pose(name) for name in ("v1", "v2")}
    planned = plan(models, part, views, sensor=sensor, time_limit_s=5.0)
    write_exposure_plan(folder / "plan.json", planned)
    write_features(folder / "features.csv", part.features)
    write_sensor(folder / "sensor.json", sensor)
    return folder


@pytest.fixture
def served(original: Path, tmp_path: Path) -> Path:
    """A copy of the served folder."""
    return Path(shutil.copytree(original, tmp_path / "served"))


@contextmanager
def asked(folder: Path, limits: Limits | None = None, token: str | None = None) -> Iterator:
    app = create_app(folder, limits=limits, token=token)
    with TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False) as client:
        yield client


@pytest.fixture(scope="session")
def asking() -> Callable[..., object]:
    """Return what asks a folder's service in this process (`asked`)."""
    return asked


@pytest.fixture(scope="session")
def client(original: Path) -> Iterator[TestClient]:
    """Ask the service of the original folder, in this process."""
    with asked(original) as client:
        yield client


@pytest.fixture(scope="session")
def capture_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The image and cloud of one capture, view v1 at 8 ms."""
    folder = tmp_path_factory.mktemp("capture")
    capture = plate_capture("v1", 8.0)
    cv2.imwrite(str(folder / "image.png"), np.asarray(capture.image))
    write_cloud(folder / "cloud.ply", capture.cloud)
    return folder


@contextmanager
def running(folder: Path, *options: str, workers: int = 1) -> Iterator[str]:
    """Run the server's command, and yield its address."""
    command = [sys.executable, "-m", "exposight", "serve", str(folder), "--port", "0"]
    log = folder.parent / f"{folder.name}.log"
    with log.open("w") as written:
        process = subprocess.Popen(
            [*command, "--workers", str(workers), *options], stdout=written, stderr=written
        )
    try:
        yield _address(process, log)
    finally:
        process.terminate()
        status = process.wait(30)
    assert status in {0, 143}, log.read_text()
    assert "Traceback" not in log.read_text()


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if found := re.search(r"http://\S+", log.read_text()):
            return found.group()
        assert process.poll() is None, log.read_text()
        time.sleep(0.05)
    raise AssertionError(log.read_text())


@pytest.fixture(scope="session")
def serving() -> Callable[..., object]:
    """Return what runs a server process (`running`)."""
    return running


@pytest.fixture(scope="session")
def address(original: Path) -> Iterator[str]:
    """The address of a server of the original folder with two workers."""
    with running(original, "--max-seconds", "3", workers=2) as found:
        yield found


# -- runs --------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def folder_to_measure(tmp_path_factory, sheet_plan, scene):
    folder = tmp_path_factory.mktemp("runs")
    plan = plate_exposure_plan()
    write_exposure_plan(folder / "plan.json", plan)
    measure_adaptively(plan, PlateDriver(), folder / "recorded", models=None)
    measure_adaptively(plan, PlateDriver(), folder / "whole", models=None)
    measure_adaptively(plan, PlateDriver(), folder / "expected", models=None)
    shutil.copytree(scene, folder / "scene")
    exposures_ms = tuple(map(float, range(30, 110, 20)))
    plane = replace(sheet_plan.planes[0], exposures_ms=exposures_ms)
    simulated = {**sheet_plan.simulated, "scene": "scene", "rings_only": True}
    write_plan(folder / "sheet.toml", replace(sheet_plan, planes=(plane,), simulated=simulated))
    plan = read_plan(folder / "sheet.toml")
    measure(plan, SimulatedCell.for_plan(plan, folder=folder), folder / "sheet-expected")
    return folder


@pytest.fixture
def run_folder(folder_to_measure, tmp_path):
    """Return a copy of a folder with what runs need, to be changed."""
    return shutil.copytree(folder_to_measure, tmp_path / "runs")


@pytest.fixture
def sheet_run():
    """Return a request for a run that takes seconds."""
    driver = {"kind": "simulated"}
    return {"name": "sheet", "plan": "sheet.toml", "driver": driver}


@pytest.fixture(scope="session")
def sheet_expected(folder_to_measure):
    """Return what such a run captures where nothing interrupts it."""
    return captured(folder_to_measure / "sheet-expected")
