"""A capture: what a sensor delivered at one view with one exposure time."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from exposight.errors import CloudError, ImageError, InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.cell.cloud import Cloud
    from exposight.cell.sensor import ActiveSensor
    from exposight.geometry import RigidTransform


_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
"""Never a path into another folder."""

_TYPES = {8: np.dtype(np.uint8), 12: np.dtype(np.uint16), 16: np.dtype(np.uint16)}


CAPTURE_FILES = (DESCRIPTION_FILE, IMAGE_FILE, CLOUD_FILE) = (
    "capture.json",
    "image.png",
    "cloud.npz",
)
"""Names of a stored capture's files, which its attachments cannot have."""


class CaptureKey(NamedTuple):
    """What tells one capture of a campaign from another."""

    view: str
    exposure_ms: float


def check_image(
    image: NDArray[np.uint8] | NDArray[np.uint16], bit_depth: int
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return a copy of a grey image that has the bit depth it is said to have, read-only.

    A copy, because cameras fill the same buffer again with their next image.

    Parameters
    ----------
    image : (rows, columns) ndarray
        uint8 for 8 bits, uint16 for 12 or 16 bits.
    bit_depth : {8, 12, 16}
        12 means that a uint16 image uses values up to 4095.

    Raises
    ------
    ImageError
        If the image is in colour, or of another type or range than the depth says.
    """
    if bit_depth not in _TYPES:
        msg = f"a bit depth must be 8, 12 or 16, got {bit_depth}"
        raise ImageError(msg)
    if image.ndim != 2 or image.size == 0:
        what = "a colour image" if image.ndim == 3 else "an array"
        msg = (
            f"a capture needs a grey image of shape (rows, columns), got {what} of shape "
            f"{image.shape}; convert it to grey"
        )
        raise ImageError(msg)
    expected = _TYPES[bit_depth]
    if image.dtype != expected:
        msg = (
            f"an image of {bit_depth} bits needs {expected}, got {image.dtype}; say its true "
            "bit_depth (8, 12 or 16), or convert it"
        )
        raise ImageError(msg)
    if bit_depth == 12 and int(image.max()) > 4095:
        msg = (
            f"an image of 12 bits has values up to 4095, got {int(image.max())}; say "
            "bit_depth=16, or shift the values if the camera left-aligns them"
        )
        raise ImageError(msg)
    own = image.copy()
    own.setflags(write=False)
    return own


@dataclass(frozen=True, kw_only=True, eq=False)
class Capture:
    """One exposure at one view: the stripe image, the cloud, and where the part was.

    Parameters
    ----------
    view : str
        Name of the sensor's position, the same for all exposure times there.
    exposure_ms : float, ms
        Exposure time that was really taken, as the sensor reports it.
    image : (rows, columns) ndarray of uint8 or uint16
        One stripe image of the first camera (Sect. 3.1.2 of the paper). Copied, made read-only.
    cloud : Cloud or None
        In the first camera's frame, mm; None where it was not kept, which is not the same as a
        cloud without any point.
    camera_from_part : RigidTransform
        Where the part stood, as the cell reports it.
    bit_depth : {8, 12, 16}
        Bits of the image: uint8 for 8, uint16 for 12 or 16.
    emulated : bool
        True where the exposure was computed from another one and not taken by a camera.
    notes : str
        Anything that people should know.
    attachments : mapping of str to bytes
        Further files to be kept with it, by name, for example raw frames. Those of a capture read
        from a campaign's folder are read when they are looked up.

    Raises
    ------
    ImageError
        If the image is in colour, or of another type or range than its bit depth says.
    InputError
        If the view has no name, the exposure time is not positive, or an attachment's name is not
        that of a file.
    """

    view: str
    exposure_ms: float
    image: NDArray[np.uint8] | NDArray[np.uint16]
    cloud: Cloud | None
    camera_from_part: RigidTransform
    bit_depth: int = 8
    emulated: bool = False
    notes: str = ""
    attachments: Mapping[str, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.view.strip():
            msg = "a capture needs the name of its view, got an empty one"
            raise InputError(msg)
        if not (math.isfinite(self.exposure_ms) and self.exposure_ms > 0):
            msg = f"an exposure time must be above 0 ms, got {self.exposure_ms} ms"
            raise InputError(msg)
        for name in self.attachments:
            if not _FILE_NAME.fullmatch(name) or name in CAPTURE_FILES:
                msg = (
                    f"an attachment needs the name of a file of its own in letters, digits, '.', "
                    f"'_' and '-', got {name!r}"
                )
                raise InputError(msg)
        object.__setattr__(self, "exposure_ms", float(self.exposure_ms))
        object.__setattr__(self, "image", check_image(self.image, self.bit_depth))

    @property
    def key(self) -> CaptureKey:
        """View and exposure time: what tells this capture from the others of its campaign."""
        return CaptureKey(self.view, self.exposure_ms)

    def __str__(self) -> str:
        return f"capture of view {self.view!r} at {self.exposure_ms:g} ms"

    def require_cloud(self) -> Cloud:
        """Return the cloud, for work that cannot do without.

        Raises
        ------
        CloudError
            If it was not kept.
        """
        if self.cloud is None:
            msg = (
                f"the {self} was kept without its cloud, so no points can be counted in it; take "
                "it again with its cloud (a simulation without clouds has observed it already: "
                "see observations.csv in its campaign)"
            )
            raise CloudError(msg)
        return self.cloud

    def grey_levels(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Return the image in grey levels from 0 to 255, the paper's scale.

        Returns
        -------
        (rows, columns) ndarray
            The image itself where it has 8 bits; float32 otherwise, so that nothing is rounded.
        """
        if self.image.dtype == np.uint8:
            return self.image.view(np.uint8)
        scale = np.float32(255.0 / (2**self.bit_depth - 1))
        return np.multiply(self.image, scale, dtype=np.float32)

    def check_fits(self, sensor: ActiveSensor) -> None:
        """Check that a sensor can have delivered this capture.

        Raises
        ------
        ImageError
            If the image is not of the size of the sensor's first camera.
        CloudError
            If the cloud is organised otherwise than the image.
        SensorError
            If the exposure time is outside the sensor's range.
        """
        size = (sensor.camera.height, sensor.camera.width)
        if self.image.shape != size:
            msg = (
                f"{self}: sensor {sensor.name!r} takes images of {size[0]} rows × {size[1]} "
                f"columns, got {self.image.shape[0]} × {self.image.shape[1]}"
            )
            raise ImageError(msg)
        cloud = self.cloud
        if cloud is not None and cloud.organised and cloud.valid.shape != size:
            msg = (
                f"{self}: an organised cloud must have the image's {size[0]} rows × {size[1]} "
                f"columns, got {cloud.valid.shape[0]} × {cloud.valid.shape[1]}"
            )
            raise CloudError(msg)
        sensor.check_exposure(self.exposure_ms)
