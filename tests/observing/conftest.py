"""Synthetic surfaces before a synthetic sensor: what a perfect measurement must give."""

from collections.abc import Callable

import numpy as np
import pytest

from exposight.cell import (
    ActiveSensor,
    Capture,
    Cloud,
    ExposureRange,
    Feature,
    Part,
)
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.observing import Observation
from exposight.observing.observe import Observer

WIDTH, HEIGHT, FOCAL_PX = 641, 481, 800.0
"""Odd sizes: the principal point is the centre of a pixel."""

DISTANCE_MM = 600.0


def make_sensor(
    *, distortion: tuple[float, ...] = (), camera_from_tcp: RigidTransform | None = None
) -> ActiveSensor:
    camera = PinholeCamera(
        width=WIDTH,
        height=HEIGHT,
        fx=FOCAL_PX,
        fy=FOCAL_PX,
        cx=(WIDTH - 1) / 2,
        cy=(HEIGHT - 1) / 2,
        distortion=distortion,
    )
    return ActiveSensor(
        name="small",
        cameras=(camera,),
        first_from_camera=(RigidTransform(),),
        projector=None,
        camera_from_tcp=camera_from_tcp or RigidTransform(translation_mm=[0, 0, DISTANCE_MM]),
        exposure=ExposureRange(min_ms=1.0, max_ms=1000.0, increment_ms=1.0),
        working_distance_mm=(400.0, 800.0),
    )


def plate_cloud(camera: PinholeCamera, camera_from_plate: RigidTransform) -> Cloud:
    """Return the cloud of a flat plate, z = 0 in its frame: one point on every pixel's ray."""
    rays = camera.rays()
    rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
    normal = camera_from_plate.z_axis
    depth = (normal @ camera_from_plate.translation_mm) / (rays @ normal)
    depth[depth <= 0] = np.nan
    return Cloud(points=rays * depth[..., None])


def hole(
    radius_mm: float = 20.0, part_from_feature: RigidTransform | None = None, name: str = "f1"
) -> Feature:
    return Feature(
        name=name,
        kind="hole",
        part_from_feature=part_from_feature or RigidTransform(),
        radius_mm=radius_mm,
    )


def make_capture(
    sensor: ActiveSensor,
    camera_from_part: RigidTransform,
    *,
    cloud: Cloud | None = None,
    image: np.ndarray | None = None,
    **settings: object,
) -> Capture:
    """Return a capture of the flat plate at z = 0 of the part, evenly grey."""
    camera = sensor.camera
    if image is None:
        image = np.full((camera.height, camera.width), 100, dtype=np.uint8)
    return Capture(
        **{"view": "v1", "exposure_ms": 10.0, **settings},
        image=image,
        cloud=cloud or plate_cloud(camera, camera_from_part),
        camera_from_part=camera_from_part,
    )


def observe(
    sensor: ActiveSensor, features: Feature | tuple[Feature, ...], *captures: Capture
) -> list[Observation]:
    """Observe captures one by one; return their rows."""
    features = (features,) if isinstance(features, Feature) else features
    observer = Observer(Part(name="part", features=features), sensor)
    return [row for capture in captures for row in observer.observe(capture)]


@pytest.fixture
def sensor() -> ActiveSensor:
    return make_sensor()


@pytest.fixture
def facing() -> RigidTransform:
    """A part squarely before the sensor, at the TCP."""
    return RigidTransform(translation_mm=[0, 0, DISTANCE_MM])


def _as_fixture(function: Callable[..., object]) -> Callable[..., object]:
    @pytest.fixture(name=function.__name__, scope="session")
    def factory() -> Callable[..., object]:
        return function

    return factory


_make_sensor = _as_fixture(make_sensor)
_plate_cloud = _as_fixture(plate_cloud)
_hole = _as_fixture(hole)
_make_capture = _as_fixture(make_capture)
_observe = _as_fixture(observe)
