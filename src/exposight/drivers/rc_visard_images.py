"""Image sets of an rc_visard: the left image and the disparity image of one moment, by gRPC."""

from __future__ import annotations

import math
import time
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.cell import Cloud, same_exposure
from exposight.drivers.rc_visard_device import milliseconds
from exposight.drivers.rc_visard_rest import RcVisardSettings
from exposight.errors import SensorError
from exposight.rc_visard_messages import MESSAGE_BYTES, STREAM_METHOD, grpc_library, message_class

_MM_PER_M = 1000.0

_KINDS: dict[str, np.dtype[Any]] = {"mono8": np.dtype("u1"), "mono16": np.dtype("<u2")}


@dataclass(frozen=True, kw_only=True)
class Optics:
    """Focal length and principal point of an image, px.

    Parameters
    ----------
    focal_px : float, px
    principal_px : (float, float), px
        Column and row, counted from the middle of the first pixel.
    """

    focal_px: float
    principal_px: tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageSet:
    """What the device computed of one pair of images.

    Parameters
    ----------
    time_s : float, s
        When the images were taken, by the device's clock.
    exposure_ms : float, ms
        For how long, as the image itself says.
    left : (rows, columns) ndarray of uint8
        The left camera's image, rectified.
    optics : Optics
        Of the left image.
    disparity : (rows', columns') ndarray of float32, px
        In pixels of its own grid, which is the left image's or a whole fraction of it; NaN where
        there is none.
    disparity_optics : Optics
        Of the disparity's grid.
    baseline_mm : float, mm
        From the left camera to the right one.
    """

    time_s: float
    exposure_ms: float
    left: NDArray[np.uint8]
    optics: Optics
    disparity: NDArray[np.float32]
    disparity_optics: Optics
    baseline_mm: float

    def cloud(self) -> Cloud:
        """Return the points in the left camera's frame, organised like the disparity, in mm."""
        optics = self.disparity_optics
        rows, columns = self.disparity.shape
        with np.errstate(divide="ignore"):  # a disparity of 0 is infinitely far, and so missing
            z = optics.focal_px * self.baseline_mm / self.disparity.astype(np.float64)
        x = (np.arange(columns) - optics.principal_px[0]) / optics.focal_px
        y = (np.arange(rows) - optics.principal_px[1]) / optics.focal_px
        return Cloud(points=np.stack([x[None, :] * z, y[:, None] * z, z], axis=-1))


def fetch_image_set(
    settings: RcVisardSettings, *, exposure_ms: float, increment_ms: float, not_before_s: float
) -> ImageSet:
    """Return the first image set that was taken after a moment with an exposure time.

    Parameters
    ----------
    settings : RcVisardSettings
    exposure_ms, increment_ms : float, ms
        Image sets with other exposure times than this one (`same_exposure`) are discarded.
    not_before_s : float, s
        By the device's clock. Earlier image sets are discarded.

    Raises
    ------
    SensorError
        If gRPC is not installed, the device does not answer, none comes in time, or it is none.
    """
    deadline = time.monotonic() + settings.images_timeout_s + 2.0 * exposure_ms / 1000.0
    last: ImageSet | None = None
    with closing(_stream(settings, deadline)) as messages:
        for message in filter(_complete, messages):
            last = read_image_set(message)
            same = same_exposure(exposure_ms, last.exposure_ms, increment_ms)
            if same and last.time_s >= not_before_s:
                return last
    where = f"rc_visard at {settings.host}:{settings.images_at}"
    if last is None:
        came = "none with a left and a disparity image came"
    elif last.time_s < not_before_s:
        came = "those that came were taken before"
    else:
        came = f"the images say {last.exposure_ms:g} ms: it ignores the setting"
    msg = (
        f"{where}: no image set of {exposure_ms:g} ms within {settings.images_timeout_s:g} s: "
        f"{came}; check acquisition modes and trigger"
    )
    raise SensorError(msg)


def _stream(settings: RcVisardSettings, deadline: float) -> Generator[Any, None, None]:
    """Yield the device's image sets until the deadline."""
    grpc = grpc_library()
    options = [("grpc.max_receive_message_length", MESSAGE_BYTES), ("grpc.enable_http_proxy", 0)]
    address = f"{settings.host}:{settings.images_at}"
    request = message_class("ImageSetRequest")(left_enabled=True, disparity_enabled=True)
    with grpc.insecure_channel(address, options=options) as channel:
        call = channel.unary_stream(
            STREAM_METHOD,
            request_serializer=lambda message: message.SerializeToString(),
            response_deserializer=message_class("ImageSet").FromString,
        )(request, timeout=max(deadline - time.monotonic(), 0.1))
        try:
            yield from call
        except grpc.RpcError as error:
            if error.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
                return
            msg = (
                f"rc_visard at {address}: its images do not come "
                f"({error.code().name.lower()}: {error.details()}); check address, cable and "
                "power. What was captured is kept: run the same command again to go on"
            )
            raise SensorError(msg) from error
        finally:
            call.cancel()


def _complete(message: Any) -> bool:
    """Tell whether a set has both images, of the same moment."""
    return bool(
        message.HasField("left")
        and message.HasField("disparity")
        and message.left.timestamp == message.disparity.timestamp
    )


def read_image_set(message: Any) -> ImageSet:
    """Return an image set of its message.

    Raises
    ------
    SensorError
        If the images are not what they say, or numbers are missing.
    """
    left, disparity = message.left, message.disparity
    grey = _pixels(left, "left image")
    if grey.dtype != np.uint8:
        msg = f"the rc_visard sent its left image as {left.encoding}; grey levels need mono8"
        raise SensorError(msg)
    steps = _pixels(disparity.image, "disparity image")
    values = steps * np.float32(disparity.scale) + np.float32(disparity.offset)
    values[steps == disparity.invalid_data_value] = np.nan
    return ImageSet(
        time_s=left.timestamp.sec + 1e-9 * left.timestamp.nsec,
        exposure_ms=milliseconds(_positive(left.exposure_time, "exposure_time")),
        left=grey.view(np.uint8),
        optics=_optics(left),
        disparity=values,
        disparity_optics=_optics(disparity.image),
        baseline_mm=_MM_PER_M * _positive(disparity.baseline, "baseline"),
    )


def _optics(image: Any) -> Optics:
    # Principal points count from the image's corner, as in the formula of the device's manual.
    return Optics(
        focal_px=_positive(image.focal_length, "focal_length"),
        principal_px=(image.principal_point_u - 0.5, image.principal_point_v - 0.5),
    )


def _pixels(image: Any, what: str) -> NDArray[Any]:
    """Return an image's pixels, (rows, columns); what pads its rows is cut off."""
    kind = _KINDS.get(image.encoding)
    rows, columns, step = image.height, image.width, image.step
    if kind is None or not columns or step < columns * kind.itemsize:
        msg = f"the rc_visard sent a {what} of {columns} px in {step} bytes as {image.encoding!r}"
        raise SensorError(msg)
    if not rows or rows * step != len(image.data):
        msg = f"the rc_visard's {what} has {len(image.data)} bytes, not {rows} rows of {step}"
        raise SensorError(msg)
    whole: NDArray[Any] = np.frombuffer(image.data, np.uint8).reshape(rows, step)
    order = kind.newbyteorder(">") if image.is_bigendian else kind
    return np.ascontiguousarray(whole[:, : columns * kind.itemsize]).view(order)


def _positive(value: float, what: str) -> float:
    if math.isfinite(value) and value > 0:
        return float(value)
    msg = f"the rc_visard sent {value:g} as {what}; it must be above 0"
    raise SensorError(msg)
