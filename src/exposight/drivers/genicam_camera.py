"""One GenICam camera: its exposure time, set and read back, and its frames.

Everything that talks to the device is here; GenICam counts in µs, the callers in ms.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from exposight.aravis_library import aravis, aravis_error
from exposight.cell import ExposureRange, Image, same_exposure
from exposight.drivers.camera_control import open_camera
from exposight.errors import InputError, SensorError

logger = logging.getLogger(__name__)

_US_PER_MS = 1000.0

_EXPOSURE_FEATURES = ("ExposureTime", "ExposureTimeAbs")
"""Of GenICam's standard, and of the cameras before it."""

_SWITCHED = {
    "AcquisitionMode": "Continuous",
    "TriggerMode": "Off",
    "GainAuto": "Off",
    "ExposureAuto": "Off",
}
"""What would change exposure times or wait for something, and how it is set meanwhile."""

_FINEST_US = 1e-6
"""Increments below it are a library's way to say that there is none."""

_USUAL_INCREMENT_US = 1.0

_BIT_DEPTHS = (8, 10, 12, 14, 16)
_PIXEL_FORMATS = tuple(f"Mono{depth}" for depth in _BIT_DEPTHS)
"""What frames are read of: grey, without packing."""

_CHUNK_FRAMES = 5
"""Frames within which a new exposure time must show in their chunk data."""

_LOST = "control was lost"

_Value = TypeVar("_Value")


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """A camera, and how long it is waited for.

    Parameters
    ----------
    id : str
        Its id, serial number or address.
    timeout_s : float, s
        How long a frame may take beyond its exposure time.
    tries : int
        How often a frame that came incompletely, or not, is asked for.
    pixel_format : str, optional
        GenICam's PixelFormat to set, such as Mono8 or Mono12; as the camera has it by default.

    Raises
    ------
    InputError
        If a number makes no sense.
    """

    id: str
    timeout_s: float = 3.0
    tries: int = 3
    pixel_format: str | None = None

    def __post_init__(self) -> None:
        if not self.id.strip() or not self.timeout_s > 0 or self.tries < 1:
            msg = (
                "a camera needs its id, a timeout_s above 0 and tries from 1 up, got "
                f"{self.id!r}, {self.timeout_s:g} and {self.tries}"
            )
            raise InputError(msg)
        if self.pixel_format not in {None, *_PIXEL_FORMATS}:
            msg = f"pixel_format is one of {', '.join(_PIXEL_FORMATS)}, got {self.pixel_format!r}"
            raise InputError(msg)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A frame as the camera sent it.

    Parameters
    ----------
    image : (rows, columns) ndarray of uint8 or uint16
    bit_depth : int
    """

    image: Image
    bit_depth: int


class GenicamCamera:
    """A camera under control, until it is closed.

    Parameters
    ----------
    settings : CameraSettings
    open_device : callable
        Returns Aravis's camera of an id, under control (`open_camera`).

    Raises
    ------
    SensorError
        If Aravis is not installed, no such camera answers, another program holds it, or it has no
        exposure time.
    """

    def __init__(
        self, settings: CameraSettings, open_device: Callable[[str], Any] = open_camera
    ) -> None:
        self.settings = settings
        self._library, self._error = aravis(), aravis_error()
        self._open_device = open_device
        self._restored: dict[str, Any] = {}
        self._lost = False
        self._fresh = False
        self._chunks: Any = None
        self._exposure_us = 0.0
        self._camera = open_device(settings.id)
        try:
            self._prepare()
        except BaseException:
            self.close()
            raise

    def _prepare(self) -> None:
        camera, library = self._camera, self._library
        camera.get_device().connect("control-lost", self._lose)
        # The device is asked each time, and refuses what is outside its range.
        camera.set_register_cache_policy(library.RegisterCachePolicy.DISABLE)
        camera.set_range_check_policy(library.RangeCheckPolicy.ENABLE)
        with self._speaking("prepare"):
            self._feature = self._exposure_feature()
            self._restored[self._feature] = camera.get_float(self._feature)
            self._switch()
            self._optional(lambda: camera.gv_auto_packet_size())
            self._chunks = self._optional(self._chunk_parser)
            self._stream = camera.create_stream(None, None)
            self._exposure_us = float(camera.get_float(self._feature))
        if self._stream is None:
            msg = f"camera {self.settings.id!r} opened no stream; is another program receiving it?"
            raise SensorError(msg)

    def _lose(self, *_: object) -> None:
        self._lost = True

    def _exposure_feature(self) -> str:
        for name in _EXPOSURE_FEATURES:
            if self._optional(lambda name=name: self._camera.is_feature_available(name)):  # type: ignore[misc]
                return name
        msg = f"camera {self.settings.id!r} has neither {' nor '.join(_EXPOSURE_FEATURES)}"
        raise SensorError(msg)

    def _switch(self) -> None:
        wanted = dict(_SWITCHED)
        if self.settings.pixel_format is not None:
            wanted["PixelFormat"] = self.settings.pixel_format
        for name, value in wanted.items():
            before = self._optional(lambda name=name: self._camera.get_string(name))  # type: ignore[misc]
            if before is None or before == value:
                continue
            try:
                self._camera.set_string(name, value)
            except self._error as error:
                msg = f"camera {self.settings.id!r} does not take {name} = {value!r}: {error}"
                raise SensorError(msg) from error
            self._restored[name] = before

    def _chunk_parser(self) -> Any:
        """Have frames carry their exposure time, where the camera can."""
        camera = self._camera
        if not camera.are_chunks_available():
            return None
        self._restored["ChunkModeActive"] = camera.get_boolean("ChunkModeActive")
        camera.set_chunks("ExposureTime")
        return camera.create_chunk_parser()

    # -- what the device is ---------------------------------------------------------------------

    @property
    def limits(self) -> ExposureRange:
        """Exposure times that the device takes, as it says now."""
        with self._speaking("read the limits"):
            bounds = self._camera.get_float_bounds(self._feature)
            low_us, high_us = float(bounds[0]), float(bounds[1])
        step_us = self._optional(lambda: self._camera.get_float_increment(self._feature))
        if step_us is None or step_us < _FINEST_US:
            step_us = _USUAL_INCREMENT_US
        return ExposureRange(
            min_ms=low_us / _US_PER_MS,
            max_ms=high_us / _US_PER_MS,
            increment_ms=step_us / _US_PER_MS,
        )

    def description(self) -> dict[str, object]:
        """Return what decides the frames, JSON-able."""
        camera = self._camera
        facts = {
            "vendor": self._optional(camera.get_vendor_name),
            "model": self._optional(camera.get_model_name),
            "serial": self._optional(camera.get_device_serial_number),
            "firmware": self._optional(lambda: camera.get_string("DeviceFirmwareVersion")),
            "pixel_format": self._optional(lambda: camera.get_string("PixelFormat")),
            "gain": self._optional(lambda: camera.get_float("Gain")),
        }
        return {name: value for name, value in facts.items() if value is not None}

    # -- exposure -------------------------------------------------------------------------------

    def set_exposure(self, exposure_ms: float) -> float:
        """Set the exposure time, and return the one that the device then has, in ms.

        Raises
        ------
        SensorError
            If the device cannot take it, ignores it, or is lost.
        """
        limits = self.limits
        clamped_ms = min(max(exposure_ms, limits.min_ms), limits.max_ms)
        if not same_exposure(exposure_ms, clamped_ms, limits.increment_ms):
            msg = (
                f"camera {self.settings.id!r} takes exposure times from {limits.min_ms:g} to "
                f"{limits.max_ms:g} ms now, {exposure_ms:g} ms was asked for; plan inside its "
                "range, or change what limits it, such as the frame rate"
            )
            raise SensorError(msg)
        with self._speaking(f"set {exposure_ms:g} ms"):
            self._camera.set_float(self._feature, clamped_ms * _US_PER_MS)
            taken_us = float(self._camera.get_float(self._feature))
        taken_ms = taken_us / _US_PER_MS
        if not same_exposure(exposure_ms, taken_ms, limits.increment_ms):
            msg = (
                f"camera {self.settings.id!r} ignored its setting: {exposure_ms:g} ms was asked "
                f"for, {taken_ms:g} ms read back; switch off what else sets it, such as an "
                "exposure mode or a user set"
            )
            raise SensorError(msg)
        self._fresh = self._fresh or taken_us != self._exposure_us
        self._exposure_us = taken_us
        return taken_ms

    # -- frames ---------------------------------------------------------------------------------

    def frame(self) -> Frame:
        """Take a frame that begins after this call, with the exposure time that was set.

        A new exposure time holds from the next frame on: the first one is discarded, or those
        whose chunk data say another exposure time.

        Raises
        ------
        SensorError
            If none comes completely within the timeout, tried several times, or the device is
            lost.
        """
        if self._chunks is None:
            if self._fresh:
                self._grab()
            frame, _ = self._grab()
        else:
            frame = self._frame_of_exposure()
        self._fresh = False
        return frame

    def _frame_of_exposure(self) -> Frame:
        taken_us: float | None = None
        for before in range(_CHUNK_FRAMES):
            frame, taken_us = self._grab()
            if taken_us is None:
                right = before > 0 or not self._fresh
            else:
                right = abs(taken_us - self._exposure_us) <= _USUAL_INCREMENT_US
            if right:
                return frame
        msg = (
            f"camera {self.settings.id!r} was set to {self._exposure_us / _US_PER_MS:g} ms, but "
            f"its frames say {(taken_us or 0.0) / _US_PER_MS:g} ms; it ignores the setting"
        )
        raise SensorError(msg)

    def _grab(self) -> tuple[Frame, float | None]:
        """Take one frame, and its exposure time in µs where it says so."""
        reason = ""
        for _ in range(self.settings.tries):
            with self._speaking("take a frame"):
                buffer = self._next_buffer()
            if buffer is None:
                reason = f"none came within {self._wait_s:g} s"
                continue
            status = buffer.get_status()
            if status == self._library.BufferStatus.SUCCESS:
                taken_us = None
                if self._chunks is not None:
                    taken_us = self._optional(
                        lambda buffer=buffer: self._chunks.get_float_value(  # type: ignore[misc]
                            buffer, "ChunkExposureTime"
                        )
                    )
                return Frame(**self._image_of(buffer)), taken_us
            reason = f"they came incompletely ({status.value_nick})"
        if self._lost:
            raise self._gone(_LOST)
        msg = (
            f"camera {self.settings.id!r} gave no frame in {self.settings.tries} tries: {reason}; "
            "check cable, network (packet size, other traffic) and trigger"
        )
        raise SensorError(msg)

    @property
    def _wait_s(self) -> float:
        return self.settings.timeout_s + 2.0 * self._exposure_us / 1e6

    def _next_buffer(self) -> Any:
        """Return the first buffer of an acquisition that begins now; None after the timeout."""
        camera, stream = self._camera, self._stream
        stream.push_buffer(self._library.Buffer.new_allocate(camera.get_payload()))
        camera.start_acquisition()
        try:
            return stream.timeout_pop_buffer(int(self._wait_s * 1e6))
        finally:
            camera.stop_acquisition()
            while stream.try_pop_buffer() is not None:  # nothing old is given back later
                pass

    def _image_of(self, buffer: Any) -> dict[str, Any]:
        rows, columns = buffer.get_image_height(), buffer.get_image_width()
        depth = self._bit_depth(buffer.get_image_pixel_format())
        kind = np.dtype(np.uint8 if depth == 8 else "<u2")
        data = np.frombuffer(buffer.get_image_data(), dtype=kind, count=rows * columns)
        return {"image": data.reshape(rows, columns), "bit_depth": depth}

    def _bit_depth(self, pixel_format: int) -> int:
        depths = {
            getattr(self._library, f"PIXEL_FORMAT_MONO_{depth}"): depth for depth in _BIT_DEPTHS
        }
        if pixel_format not in depths:
            msg = (
                f"camera {self.settings.id!r} sends pixel format 0x{pixel_format:08x}; set "
                'pixel_format = "Mono8", or Mono10 to Mono16, without packing'
            )
            raise SensorError(msg)
        return depths[pixel_format]

    # -- faults and the end ---------------------------------------------------------------------

    @contextlib.contextmanager
    def _speaking(self, what: str) -> Any:
        """Turn what Aravis raises into an error that says what to do."""
        try:
            yield
        except self._error as error:
            why = f"cannot {what}: {error}"
            raise self._gone(why) from error

    def _gone(self, why: str) -> SensorError:
        return SensorError(
            f"camera {self.settings.id!r}: {why}. What was captured is kept: check cable and "
            "power, and run the same command again to go on"
        )

    def _optional(self, call: Callable[[], _Value]) -> _Value | None:
        """Return what an optional feature says, None where it is not there: they may raise."""
        try:
            return call()
        except (self._error, AttributeError):
            return None

    def close(self) -> None:
        """Restore the settings that the camera had, and give up control; once."""
        camera, self._camera = getattr(self, "_camera", None), None
        if camera is None:
            return
        self._stream = None
        left, self._restored = self._restored, {}
        while left and not self._lost:
            name = next(iter(left))
            if not self._restore(camera, name, left[name]):
                break  # it does not answer any more; each try would wait for its timeout
            del left[name]
        if left:
            logger.warning("settings were not restored, set %s by hand", left)

    def _restore(self, camera: Any, name: str, value: Any) -> bool:
        setters = {bool: camera.set_boolean, float: camera.set_float, str: camera.set_string}
        try:
            setters[type(value)](name, value)
        except self._error:
            return self._optional(lambda: camera.get_float(self._feature)) is not None
        return True
