"""A sensor of a few pixels, a part of three features, and captures of them."""

from collections.abc import Callable

import numpy as np
import pytest

from exposight.cell import ActiveSensor, Capture, Cloud, ExposureRange, Feature, Part, Projector
from exposight.geometry import PinholeCamera, RigidTransform, rotation_facing

ROWS, COLUMNS = 12, 16


def small_sensor(name: str = "small") -> ActiveSensor:
    camera = PinholeCamera(
        width=COLUMNS, height=ROWS, fx=20.1, fy=20.2, cx=7.5, cy=5.5, distortion=(0.1, 0, 0, 0)
    )
    return ActiveSensor(
        name=name,
        cameras=(camera,),
        first_from_camera=(RigidTransform(),),
        projector=Projector(
            camera=camera,
            camera_from_projector=RigidTransform.from_fanuc_wpr((220.0, 0.0, 80.0), 3, -20, 11),
        ),
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, 600.0])),
        exposure=ExposureRange(min_ms=1.0, max_ms=1000.0, increment_ms=0.5),
        working_distance_mm=(400.0, 800.0),
    )


def small_part(name: str = "sheet") -> Part:
    tilted = rotation_facing([0.1, 0.2, 1.0], [1.0, 0.5, 0.0])
    poses = [
        RigidTransform(rotation=tilted, translation_mm=np.array([20.0 * i, 1 / 3, -0.1]))
        for i in range(3)
    ]
    return Part(
        name=name,
        features=(
            Feature(name="h1", kind="hole", part_from_feature=poses[0], radius_mm=5.0),
            Feature(name="p1", kind="surface_point", part_from_feature=poses[1], radius_mm=4.0),
            Feature(
                name="s1",
                kind="slot",
                part_from_feature=poses[2],
                radius_mm=3.0,
                length_mm=20.0,
                width_mm=6.0,
            ),
        ),
    )


def small_capture(exposure_ms: float = 10.0, view: str = "v1") -> Capture:
    rng = np.random.default_rng(int(exposure_ms))
    points = rng.normal(600.0, 5.0, (ROWS, COLUMNS, 3)).astype(np.float32)
    points[rng.random((ROWS, COLUMNS)) < 0.3] = np.nan
    return Capture(
        view=view,
        exposure_ms=exposure_ms,
        image=rng.integers(0, 256, (ROWS, COLUMNS), dtype=np.uint8),
        cloud=Cloud(points=points),
        camera_from_part=RigidTransform.from_fanuc_wpr((1.0, 2.0, 600.0), 1.5, -2.5, 30.0),
        notes="Ärger & Freude",
    )


@pytest.fixture
def sensor() -> ActiveSensor:
    return small_sensor()


@pytest.fixture
def part() -> Part:
    return small_part()


@pytest.fixture
def make_sensor() -> Callable[..., ActiveSensor]:
    return small_sensor


@pytest.fixture
def make_part() -> Callable[..., Part]:
    return small_part


@pytest.fixture
def make_capture() -> Callable[..., Capture]:
    return small_capture
