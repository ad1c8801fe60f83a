"""The device behind the interfaces: its parameters, where it stands, and what it sees."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.errors import SensorError
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.imaging import match_pair
from exposight.rc_visard_messages import message_class
from exposight.twin.sensors import DotSensor
from exposight.twin.simulated_cell import SimulatedCell, sensor_model

CAMERA, MATCHING, OUTPUTS = "rc_camera", "rc_stereomatching", "rc_iocontrol"

QUALITIES = {"Full": 1, "High": 2, "Medium": 4, "Low": 6}
"""Pixels of the image along either axis that a pixel of the disparity image takes."""

_OUTPUT_MODES = ("Low", "High", "ExposureActive", "ExposureAlternateActive")

_CLOCK_S = 1_500_000_000.0
"""Its clock is not the client's."""

_DISPARITY_STEP = 0.0625
"""Pixels a step of the disparity image, as the device's."""


@dataclass(kw_only=True)
class Misbehaviour:
    """What the device does wrong, on request; may be changed while it is served.

    Parameters
    ----------
    too_many : int
        Requests that it will refuse with 429.
    dropped : int
        Connections that it will drop without an answer.
    faults : int
        Requests that it will answer with 500.
    return_code : int
        Of settings: other than 0, with status 200 and nothing set.
    ignores_exposure : bool
        Settings of the exposure time are answered as if they were taken.
    images_ignore_exposure : bool
        It is taken, but the images go on with the one before.
    rounding_s : float, s
        To whose multiples it rounds exposure times.
    delay_s : float, s
        How long it takes for an answer.
    stale_sets : int
        Image sets from before, with which each stream begins.
    silent : bool
        No image sets come.
    """

    too_many: int = 0
    dropped: int = 0
    faults: int = 0
    return_code: int = 0
    ignores_exposure: bool = False
    images_ignore_exposure: bool = False
    rounding_s: float = 0.0
    delay_s: float = 0.0
    stale_sets: int = 0
    silent: bool = False


class ServedDevice:
    """What both interfaces share; may be used by several threads.

    Parameters
    ----------
    cell : SimulatedCell
        With a sensor of two rectified cameras.
    misbehaviour : Misbehaviour

    Raises
    ------
    SensorError
        If the sensor is another one.
    """

    def __init__(self, cell: SimulatedCell, misbehaviour: Misbehaviour) -> None:
        model = sensor_model(cell.sensor, cell.settings)
        if not isinstance(model, DotSensor) or not _rectified(cell):
            msg = (
                f"sensor {cell.sensor.name!r} cannot be served as an rc_visard, which has two "
                "rectified cameras side by side and a projector of dots; take rc-visard-65"
            )
            raise SensorError(msg)
        self.cell, self.misbehaviour = cell, misbehaviour
        self.model = model
        self._lock = threading.RLock()
        self._at: tuple[str, RigidTransform] | None = None
        self._taken_s = 0.005
        self._kept: tuple[object, Any] = (None, None)
        self._before: Any = None
        exposure = cell.sensor.exposure
        limits = (round(exposure.min_ms / 1000.0, 12), round(exposure.max_ms / 1000.0, 12))
        self.nodes = {
            CAMERA: _parameters(
                exp_control=("Auto", ("Manual", "Auto", "HDR")),
                exp_auto=(True, None),
                exp_value=(0.005, limits),
                gain_value=(0.0, (0.0, 18.0)),
                fps=(25.0, (1.0, 25.0)),
            ),
            MATCHING: _parameters(
                quality=("High", tuple(QUALITIES)),
                double_shot=(False, None),
                minconf=(0.5, (0.5, 1.0)),
            ),
            OUTPUTS: _parameters(
                out1_mode=("Low", _OUTPUT_MODES), out2_mode=("Low", _OUTPUT_MODES)
            ),
        }

    def time_s(self) -> float:
        """Return the device's clock."""
        return _CLOCK_S + time.monotonic()

    def value(self, node: str, name: str) -> Any:
        """Return a parameter's value."""
        return self.nodes[node][name]["value"]

    def set(self, node: str, name: str, value: object) -> None:
        """Set a parameter.

        Raises
        ------
        KeyError
            If there is none.
        ValueError
            If the value is impossible.
        """
        with self._lock:
            entry = self.nodes[node][name]
            _check(entry, value)
            if name == "exp_value":
                if self.misbehaviour.ignores_exposure:
                    return
                step = self.misbehaviour.rounding_s
                exact = float(value)  # type: ignore[arg-type]
                value = (
                    min(max(round(exact / step) * step, entry["min"]), entry["max"])
                    if step
                    else exact
                )
            entry["value"] = value

    def reset(self, node: str) -> None:
        """Give a node's parameters their defaults."""
        with self._lock:
            for entry in self.nodes[node].values():
                entry["value"] = entry["default"]

    def move(self, view: str, camera_from_part: RigidTransform) -> RigidTransform:
        """Stand at a pose, and return the one that is reported."""
        with self._lock:
            self._at = (view, camera_from_part)
            self.image_set()  # traces it, while nobody waits for images
        return self.cell.reported_pose(camera_from_part, view)

    def image_set(self) -> Any:
        """Return an image set that is taken now, as a message."""
        with self._lock:
            if not self.misbehaviour.images_ignore_exposure:
                self._taken_s = self.value(CAMERA, "exp_value")
            key = (self._at, self._taken_s, self.value(MATCHING, "quality"))
            if self._kept[0] != key:
                self._before = self._kept[1]
                self._kept = (key, self._message())
            message = message_class("ImageSet")()
            message.CopyFrom(self._kept[1])
            _stamp(message, self.time_s())
            return message

    def stale_set(self) -> Any:
        """Return the image set from before the last change, or None."""
        return self._before

    def _message(self) -> Any:
        """Take images and match them; the lock is held."""
        ratio = QUALITIES[self.value(MATCHING, "quality")]
        camera, baseline_mm = self.cell.sensor.camera, self.model.pair.baseline_mm
        left, disparity = self._seen(ratio, baseline_mm)
        message = message_class("ImageSet")()
        _fill(message.left, left, "mono8", camera, 1, self._taken_s)
        message.disparity.scale = _DISPARITY_STEP
        message.disparity.baseline = baseline_mm / 1000.0
        _fill(message.disparity.image, disparity, "mono16", camera, ratio, self._taken_s)
        _stamp(message, self.time_s())
        return message

    def _seen(self, ratio: int, baseline_mm: float) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
        """Return the left image and the steps of disparity, 0 where there is none."""
        camera = self.cell.sensor.camera
        grid = (camera.height // ratio, camera.width // ratio)
        if self._at is None:
            black = np.zeros((camera.height, camera.width), dtype=np.uint8)
            return black, np.zeros(grid, dtype=np.uint16)
        view, pose = self._at
        exposure_ms = round(1000.0 * self._taken_s, 6)
        left, right = self.cell.stereo_images(exposure_ms, pose, view=view)
        cloud = match_pair(
            left.view(np.uint8),
            right.view(np.uint8),
            self.model.pair,
            depth_limits_mm=self.model.matched_mm,
            limits=self.model.matching,
            downsample=ratio,
        )
        depth = cloud.points[..., 2].astype(np.float64)
        steps = camera.fx / ratio * baseline_mm / depth / _DISPARITY_STEP
        return left.view(np.uint8), np.nan_to_num(steps).round().astype(np.uint16)


def _rectified(cell: SimulatedCell) -> bool:
    """Tell whether a sensor's cameras are alike, without distortion, and side by side."""
    first, second = cell.sensor.cameras
    pose = cell.sensor.first_from_camera[1]
    aside = np.allclose(pose.rotation, np.eye(3)) and not pose.translation_mm[1:].any()
    plain = first == second and first.fx == first.fy and not any(first.distortion)
    return bool(plain and aside and first.skew == 0.0)


def _parameters(**entries: tuple[Any, Any]) -> dict[str, dict[str, Any]]:
    """Return parameters as the interface describes them, of their defaults and limits."""
    kinds = {bool: "bool", float: "float64", str: "string"}
    described = {}
    for name, (default, limits) in entries.items():
        numeric = isinstance(default, float)
        described[name] = {
            "name": name,
            "type": kinds[type(default)],
            "default": default,
            "value": default,
            "min": limits[0] if numeric else "",
            "max": limits[1] if numeric else "",
            "description": "" if numeric or limits is None else f"[{', '.join(limits)}]",
        }
    return described


def _check(entry: dict[str, Any], value: object) -> None:
    good = isinstance(value, {"bool": bool, "string": str}.get(entry["type"], (int, float)))
    if good and entry["type"] == "float64":
        good = entry["min"] <= value <= entry["max"]
    if good and entry["type"] == "string":
        good = str(value) in entry["description"].strip("[]").split(", ")
    if not good:
        msg = f"invalid value {value!r} of {entry['name']}"
        raise ValueError(msg)


def _fill(
    image: Any,
    pixels: NDArray[Any],
    encoding: str,
    camera: PinholeCamera,
    ratio: int,
    exposure_s: float,
) -> None:
    """Put pixels and optics into an image's message."""
    image.height, image.width = pixels.shape
    image.encoding, image.step = encoding, pixels.shape[1] * pixels.itemsize
    image.data = pixels.astype(pixels.dtype.newbyteorder("<")).tobytes()
    image.focal_length = camera.fx / ratio
    image.principal_point_u = (camera.cx + 0.5) / ratio
    image.principal_point_v = (camera.cy + 0.5) / ratio
    image.exposure_time = exposure_s


def _stamp(message: Any, time_s: float) -> None:
    """Give a set and its images one time."""
    sec = int(time_s)
    for each in (message, message.left, message.disparity, message.disparity.image):
        each.timestamp.sec, each.timestamp.nsec = sec, int(1e9 * (time_s - sec))
