"""The paper's two sensors, ready to use.

Each figure has its source beside it. What the paper does not give is said to be assumed; replace it
with your own sensor's calibration (`write_sensor`, edit, `read_sensor`).

Table 7 gives each projector's "transformation between camera and projector" as a position and
"(0, −20, 0)°". It is read here as ``camera_from_projector``: the projector's position in the
camera's frame, and its axes turned by Ry(−20°) within it. Its optical axis is then
Ry(−20°)·(0, 0, 1) = (−0.34, 0, 0.94): a projector at x = +220 mm looks back towards −x and crosses
the measuring field, and surfaces at +x are lit more strongly, as Sect. 3.4.8 reports. Turned by
+20° instead it would look away from the field.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np

from exposight.cell.sensor import ActiveSensor, Projector, read_sensor
from exposight.errors import SensorError, did_you_mean
from exposight.geometry import PinholeCamera, RigidTransform

PresetName = Literal["comet-pro-ae", "rc-visard-65"]


def _ideal_camera(width: int, height: int, focal_length_px: float) -> PinholeCamera:
    """Square pixels, principal point in the image's middle, no distortion: assumed throughout."""
    return PinholeCamera(
        width=width,
        height=height,
        fx=focal_length_px,
        fy=focal_length_px,
        cx=(width - 1) / 2,
        cy=(height - 1) / 2,
    )


def _ahead(distance_mm: float) -> RigidTransform:
    return RigidTransform(translation_mm=np.array([0.0, 0.0, distance_mm]))


def _comet_pro_ae() -> ActiveSensor:
    # Sect. 3.2.1: 4 megapixels. Table 7: a field of 0.59 m × 0.39 m at 0.60 m. 2464 × 1632 is the
    # size of 4 megapixels at that aspect (assumed), and the field's width gives the focal length.
    width, height = 2464, 1632
    focal_length_px = width * 600.0 / 590.0
    projector = Projector(
        # 1920 × 1200 px is assumed. Table 7 gives no projector's field, but the real one covers the
        # measuring field: 1360 px is the longest focal length, rounded down to tens, that lights
        # the whole field at 0.40, 0.60 and 0.80 m from that position.
        camera=_ideal_camera(1920, 1200, 1360.0),
        # Table 7: (0.22, 0.0, 0.08) m and (0, −20, 0)°.
        camera_from_projector=RigidTransform.from_fanuc_wpr((220.0, 0.0, 80.0), 0.0, -20.0, 0.0),
    )
    return ActiveSensor(
        name="ZEISS COMET Pro AE",
        cameras=(_ideal_camera(width, height, focal_length_px),),
        first_from_camera=(RigidTransform(),),
        projector=projector,
        # Sect. 3.1.2: the TCP lies in the middle plane of the working volume; Table 7: 0.60 m. That
        # it lies on the camera's axis is assumed.
        camera_from_tcp=_ahead(600.0),
        exposure_min_ms=1.0,  # Table 7: 1–1000 ms
        exposure_max_ms=1000.0,
        exposure_increment_ms=1.0,  # assumed: the paper's exposure times are whole ms
        working_distance_mm=(400.0, 800.0),  # Table 7: planes at 0.40, 0.60 and 0.80 m
    )


def _rc_visard_65() -> ActiveSensor:
    # Roboception's hardware specification: 1280 × 960 px, 61° × 48°, baseline 65 mm. 61° across
    # gives the focal length; with square pixels the height is then 47.7°.
    width, height = 1280, 960
    focal_length_px = width / 2 / math.tan(math.radians(61.0 / 2))
    camera = _ideal_camera(width, height, focal_length_px)
    projector = Projector(
        # 1024 × 1024 px is assumed, and so is the field of 77° × 77°: Roboception gives 62° × 48°
        # for the RandomDot, but from the position in Table 7, 290 mm before the middle plane, that
        # would light only half of the measuring field.
        camera=_ideal_camera(1024, 1024, 640.0),
        # Table 7: (0.18, −0.05, 0.21) m and (0, −20, 0)°.
        camera_from_projector=RigidTransform.from_fanuc_wpr((180.0, -50.0, 210.0), 0.0, -20.0, 0.0),
    )
    return ActiveSensor(
        name="Roboception rc_visard 65 with RandomDot projector",
        cameras=(camera, camera),
        # Rectified pair: the second (right) camera stands one baseline along +x.
        first_from_camera=(
            RigidTransform(),
            RigidTransform(translation_mm=np.array([65.0, 0.0, 0.0])),
        ),
        projector=projector,
        # Table 7: the middle one of three planes is at 0.50 m. On the left camera's axis: assumed.
        camera_from_tcp=_ahead(500.0),
        exposure_min_ms=0.07,  # Table 7: 0.07–18 ms
        exposure_max_ms=18.0,
        exposure_increment_ms=0.001,  # assumed: 1 µs, the unit of GenICam's ExposureTime
        working_distance_mm=(100.0, 1000.0),  # Table 7: planes at 0.10, 0.50 and 1.00 m
    )


PRESETS: Mapping[PresetName, Callable[[], ActiveSensor]] = MappingProxyType(
    {"comet-pro-ae": _comet_pro_ae, "rc-visard-65": _rc_visard_65}
)
"""Builders of the paper's sensors (Table 7), by name."""


def sensor_preset(name: str) -> ActiveSensor:
    """Return one of the paper's sensors (Table 7).

    Parameters
    ----------
    name : {'comet-pro-ae', 'rc-visard-65'}
        ZEISS COMET Pro AE (structured light) or Roboception rc_visard 65 (active stereo).

    Raises
    ------
    SensorError
        If there is no such preset.
    """
    for known, build in PRESETS.items():
        if known == name:
            return build()
    msg = f"no sensor preset is called {name!r}; there are {', '.join(PRESETS)}"
    raise SensorError(msg + did_you_mean(name, PRESETS))


def sensor_named_or_read(name_or_path: str | Path) -> ActiveSensor:
    """Return the sensor that a preset's name or the path of a JSON file stands for.

    Parameters
    ----------
    name_or_path : str or path
        A key of `PRESETS`, or a sensor's JSON file.

    Raises
    ------
    SensorError
        If it is neither.
    FileError
        If the file cannot be read as a sensor.
    """
    name, path = str(name_or_path), Path(name_or_path)
    if name in PRESETS:
        return sensor_preset(name)
    if path.is_file() or path.suffix.lower() == ".json":
        return read_sensor(path)
    msg = (
        f"no sensor '{name}': expected one of the presets {', '.join(PRESETS)}, or the JSON file "
        "of a sensor (every campaign folder has its own, sensor.json)"
    )
    raise SensorError(msg + did_you_mean(name, PRESETS))
