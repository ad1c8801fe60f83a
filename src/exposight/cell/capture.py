"""A capture: what a sensor delivered at one view with one exposure time, and its folder on disk."""

import math
import re
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from exposight import files
from exposight.cell.cloud import Cloud
from exposight.cell.cloud_archive import cloud_from_npz, npz_of
from exposight.cell.image import GREY_MAX, Image, full_scale, png_bytes, read_only
from exposight.cell.image_files import decoded_image
from exposight.cell.sensor import ActiveSensor, StoredPose
from exposight.cell.stack_images import BrightnessSource, StackImages, check_source
from exposight.errors import CloudError, FormatError, ImageError, InputError
from exposight.geometry import RigidTransform, grid_ratio

_DESCRIPTION, _IMAGE, _CLOUD = _FILES = ("capture.json", "image.png", "cloud.npz")

_STACK_FILES = {name: f"{name}.png" for name in ("mean", "maximum", "modulation")}

_PNG_HEAD = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"

_FILE_NAME = "[A-Za-z0-9][A-Za-z0-9._-]*"
"""Never a path into another folder."""


class CaptureKey(NamedTuple):
    """Identifies a capture within its campaign."""

    view: str
    exposure_ms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Capture:
    """One exposure at one view: the stripe image, the cloud, and where the part was.

    Parameters
    ----------
    view : str
        Name of the sensor's position, the same for all exposure times there.
    exposure_ms : float, ms
        Exposure time that was really taken, as the sensor reports it; the longest of those that
        were merged.
    image : (rows, columns) ndarray of uint8 or uint16
        One image of the first camera, in which brightness is averaged (Sect. 3.1.2 of the paper);
        `brightness_source` says which. Copied, made read-only.
    cloud : Cloud or None
        In the first camera's frame, mm, organised like the image or at a whole fraction of its
        resolution, or not organised; None where it was not kept, which is not the same as a
        cloud without any point.
    camera_from_part : RigidTransform
        Where the part stood, as the cell reports it.
    bit_depth : int, 8 to 16
        Bits of the image: uint8 for 8, the low bits of uint16 for more.
    emulated : bool
        True where the exposure was computed from another one and not taken by a camera.
    notes : str
        Anything that people should know.
    attachments : mapping of str to bytes
        Further files to be kept with it, by name, for example raw frames. Those of a capture read
        from a campaign's folder are read when they are looked up.
    stack : StackImages or None
        What all its frames tell of each pixel, in the image's size and bit depth; copied likewise.
    brightness_source : {"stripe", "stripes-mean", "texture", "dots", "merged"}
        What the image is (`BrightnessSource`).

    Raises
    ------
    ImageError
        If an image is in colour, or of another type or range than the bit depth says, or one of
        the stack has another size.
    InputError
        If the view has no name, the exposure time is not positive, an attachment's name is not
        that of a file, or the image and its stack contradict each other.
    """

    view: str
    exposure_ms: float
    image: Image
    cloud: Cloud | None
    camera_from_part: RigidTransform
    bit_depth: int = 8
    emulated: bool = False
    notes: str = ""
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    stack: StackImages | None = None
    brightness_source: BrightnessSource = "stripe"

    def __post_init__(self) -> None:
        if not self.view.strip():
            msg = "a capture needs the name of its view, got an empty one"
            raise InputError(msg)
        files.check_plain(self.view, "the view", InputError)
        if not (math.isfinite(self.exposure_ms) and self.exposure_ms > 0):
            msg = f"an exposure time must be above 0 ms, got {self.exposure_ms} ms"
            raise InputError(msg)
        taken = _FILES if self.stack is None else (*_FILES, *_STACK_FILES.values())
        for name in self.attachments:
            if not re.fullmatch(_FILE_NAME, name) or name in taken:
                msg = (
                    f"an attachment needs a file name of its own, in letters, digits, '.', "
                    f"'_' and '-', got {name!r}"
                )
                raise InputError(msg)
        object.__setattr__(self, "exposure_ms", float(self.exposure_ms))
        object.__setattr__(self, "image", read_only(self.image, self.bit_depth, "image"))
        check_source(self.brightness_source, self.stack)
        if self.stack is not None:
            stack = self.stack.checked(self.image.shape, self.bit_depth)
            object.__setattr__(self, "stack", stack)

    @property
    def key(self) -> CaptureKey:
        """View and exposure time, which identify this capture within its campaign."""
        return CaptureKey(self.view, self.exposure_ms)

    def __str__(self) -> str:
        if self.brightness_source == "merged":
            return f"merged capture of view {self.view!r}, up to {self.exposure_ms:g} ms"
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

    @property
    def full_scale(self) -> int:
        """The image's largest grey level, at which a pixel counts as clipped."""
        return full_scale(self.bit_depth)

    def grey_levels(self) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Return the image in grey levels from 0 to 255, the paper's scale.

        Returns
        -------
        (rows, columns) ndarray
            The image itself where it has 8 bits; float32 otherwise, so that nothing is rounded.
        """
        if self.image.dtype == np.uint8:
            return self.image.view(np.uint8)
        scale = np.float32(GREY_MAX / self.full_scale)
        return np.multiply(self.image, scale, dtype=np.float32)

    def check_fits(self, sensor: ActiveSensor) -> None:
        """Check that a sensor can have delivered this capture.

        Raises
        ------
        ImageError
            If the image is not of the size of the sensor's first camera.
        CloudError
            If the cloud is organised otherwise than the image, and not at a whole fraction of its
            resolution.
        SensorError
            If the exposure time is outside the sensor's range by an increment or more.
        """
        size = (sensor.camera.height, sensor.camera.width)
        if self.image.shape != size:
            msg = (
                f"{self}: sensor {sensor.name!r} takes images of {size[0]} rows × {size[1]} "
                f"columns, got {self.image.shape[0]} × {self.image.shape[1]}"
            )
            raise ImageError(msg)
        cloud = self.cloud
        if cloud is not None and cloud.organised and grid_ratio(cloud.valid.shape, size) is None:
            msg = (
                f"{self}: an organised cloud must have the image's {size[0]} rows × {size[1]} "
                f"columns, or half, a third, … of both, got {cloud.valid.shape[0]} × "
                f"{cloud.valid.shape[1]}"
            )
            raise CloudError(msg)
        sensor.check_taken_exposure(self.exposure_ms)


# -- on disk ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class StackDescription:
    """What ``capture.json`` says of a capture's stack images."""

    mean_sha256: files.Checksum | None
    maximum_sha256: files.Checksum
    modulation_sha256: files.Checksum
    min_modulation: float | None


@dataclass(frozen=True, kw_only=True)
class CaptureDescription:
    """What ``capture.json`` says: all but images, cloud and attachments (``docs/formats.md``)."""

    view: str
    exposure_ms: float
    bit_depth: int
    emulated: bool
    notes: str
    camera_from_part: StoredPose
    image_sha256: files.Checksum
    cloud_sha256: files.Checksum | None
    beside_sha256: dict[Annotated[str, Field(pattern=f"^{_FILE_NAME}$")], files.Checksum] = field(
        default_factory=dict
    )
    """Of the attachments; not in version 1."""
    brightness_source: BrightnessSource = "stripe"
    stack: StackDescription | None = None
    """Both not before version 3."""

    def __post_init__(self) -> None:
        files.check_plain(self.view, "the view", InputError)

    @property
    def key(self) -> CaptureKey:
        """View and exposure time."""
        return CaptureKey(self.view, self.exposure_ms)


_DESCRIBED = (
    *("view", "exposure_ms", "bit_depth", "emulated", "notes", "camera_from_part"),
    "brightness_source",
)
"""Fields that a capture and its description share."""

_FORMAT = files.DocumentFormat("exposight capture", 5, CaptureDescription)
"""2: a capture may lack its cloud, and have attachments. 3: it may have stack images. 4: it may be
merged. 5: its cloud may have standard deviations. Each is written as the first version that has all
of it, which older versions of exposight read."""


def write_capture(folder: Path, capture: Capture) -> None:
    """Write a capture as a new folder that appears whole or not at all.

    Parameters
    ----------
    folder : Path
        The folder to make.
    capture : Capture
        What goes into it, its attachments included.

    Raises
    ------
    FileError
        If the disk is full or refuses for another reason.
    """
    contents = {**capture.attachments, _IMAGE: png_bytes(capture.image)}
    if capture.cloud is not None:
        contents[_CLOUD] = npz_of(capture.cloud)
    if capture.stack is not None:
        images = capture.stack.images()
        contents |= {_STACK_FILES[name]: png_bytes(image) for name, image in images.items()}
    checksums = {name: files.sha256_of(content) for name, content in contents.items()}
    stack = None
    if capture.stack is not None:
        stack = StackDescription(
            mean_sha256=checksums.pop(_STACK_FILES["mean"], None),
            maximum_sha256=checksums.pop(_STACK_FILES["maximum"]),
            modulation_sha256=checksums.pop(_STACK_FILES["modulation"]),
            min_modulation=capture.stack.min_modulation,
        )
    description = CaptureDescription(
        **{name: getattr(capture, name) for name in _DESCRIBED},
        stack=stack,
        image_sha256=checksums.pop(_IMAGE),
        cloud_sha256=checksums.pop(_CLOUD, None),
        beside_sha256=checksums,
    )
    with files.durable_folder(folder) as unfinished:
        for name, content in contents.items():
            (unfinished / name).write_bytes(content)
        version = 4 if capture.brightness_source == "merged" else 3
        if capture.cloud is not None and capture.cloud.sigma_z_mm is not None:
            version = 5
        sealed = replace(_FORMAT, version=version).seal(description)
        (unfinished / _DESCRIPTION).write_bytes(sealed)


def read_description(folder: Path) -> CaptureDescription:
    """Return what is known of a capture without reading its image and cloud.

    Raises
    ------
    MissingFileError, DamagedFileError, FormatError, VersionError
        As `read_capture`.
    """
    path = folder / _DESCRIPTION
    return _FORMAT.unseal(files.read_bytes(path, "file of a campaign"), str(path))


def read_capture(folder: Path, sensor: ActiveSensor | None = None) -> Capture:
    """Read a capture, verify its checksums, and check all that is checked when one is written.

    Parameters
    ----------
    folder : Path
    sensor : ActiveSensor, optional
        That took it (`Capture.check_fits`).

    Raises
    ------
    MissingFileError
        If the folder or one of its files is not there.
    DamagedFileError
        If a file's content is not what was written; the message names it.
    FormatError
        If the description is not one of a capture, or the capture none that can be written.
    VersionError
        If a newer version of exposight wrote it.
    """
    description = read_description(folder)
    size = None if sensor is None else (sensor.camera.height, sensor.camera.width)
    try:
        with ThreadPoolExecutor(1) as beside:  # decoding takes as long as the cloud does
            stack = beside.submit(_read_stack, folder, description.stack, size)
            image = _read_image(folder / _IMAGE, description.image_sha256, size)
            cloud = None
            if description.cloud_sha256 is not None:
                cloud = cloud_from_npz(
                    _verified(folder / _CLOUD, description.cloud_sha256), folder / _CLOUD
                )
        capture = Capture(
            **{name: getattr(description, name) for name in _DESCRIBED},
            image=image,
            cloud=cloud,
            attachments=StoredAttachments(folder, description.beside_sha256),
            stack=stack.result(),
        )
        if sensor is not None:
            capture.check_fits(sensor)
    except InputError as error:
        msg = f"{folder}: {error}"
        raise FormatError(msg) from error
    return capture


class StoredAttachments(Mapping[str, bytes]):
    """A stored capture's further files by name, each read and verified when it is looked up.

    Parameters
    ----------
    folder : Path
        Where they lie.
    checksums : mapping of str to str
        SHA-256 of each by its name.
    """

    def __init__(self, folder: Path, checksums: Mapping[str, str]) -> None:
        self._folder = folder
        self._checksums = dict(sorted(checksums.items()))

    def __getitem__(self, name: str) -> bytes:
        return _verified(self._folder / name, self._checksums[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._checksums)

    def __len__(self) -> int:
        return len(self._checksums)


def _verified(path: Path, sha256: str) -> bytes:
    return files.read_verified(path, sha256, "file of a campaign")


def _read_stack(
    folder: Path, stack: StackDescription | None, size: tuple[int, int] | None
) -> StackImages | None:
    if stack is None:
        return None
    checksums = {name: getattr(stack, f"{name}_sha256") for name in _STACK_FILES}
    images: dict[str, Any] = {
        name: _read_image(folder / _STACK_FILES[name], sha256, size)
        for name, sha256 in checksums.items()
        if sha256 is not None
    }
    return StackImages(**images, min_modulation=stack.min_modulation)


def _read_image(path: Path, sha256: str, size: tuple[int, int] | None) -> Image:
    """Decode a PNG image whose header says that it is grey, and of the size it must have."""
    data = _verified(path, sha256)
    if data[:16] != _PNG_HEAD or data[25:26] != b"\0":
        msg = f"{path} is no PNG image of grey levels"
        raise FormatError(msg)
    columns, rows = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    if size is not None and size != (rows, columns):
        msg = (
            f"{path} is an image of {rows} rows × {columns} columns, where the sensor's have "
            f"{size[0]} × {size[1]}; it is turned, or another sensor's"
        )
        raise FormatError(msg)
    image = decoded_image(data, path)
    image.setflags(write=False)  # so that `Capture`, which checks it, needs no copy
    return cast("Image", image)
