"""Captures that are uploaded: an image and a cloud in files, and what the files do not tell."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from fastapi import Request
from pydantic import Field
from starlette.datastructures import FormData, UploadFile

from exposight import cell
from exposight.cell.cloud_archive import cloud_from_npz
from exposight.cell.image_files import announced_pixels
from exposight.errors import ExposightError, InputError
from exposight.files import read_arrays, read_bytes
from exposight.imaging import Alignment, CaptureForm, Channel
from exposight.service.bodies import Body, Posed
from exposight.service.faults import RequestError
from exposight.service.guard import Limits

_MOST_ABOUT = 4_000_000
"""Bytes of the part that describes an upload."""


_OF_CLOUDS = ("cloud_unit", "cloud_axes", "depth_scale_mm")
"""Keys of `FileForm` about clouds in files that do not tell it."""


class FileForm(Body):
    """What files of captures do not tell themselves."""

    brightness_source: cell.BrightnessSource = Field(
        default="stripe", description="What the image is."
    )
    bit_depth: cell.BitDepth = Field(default=8, description="Bit depth of the image, 8 to 16.")
    alignment: Alignment = Field(default="low", description="Which bits of 16 hold the grey level.")
    saturation_level: int | None = Field(
        default=None,
        ge=1,
        le=65535,
        description="Grey level from which on the sensor saturates, where below full scale.",
    )
    channel: Channel | None = Field(default=None, description="Which channel of a colour image.")
    cloud_unit: Literal["mm", "cm", "m"] | None = Field(
        default=None, description="Unit of the cloud; mm by default."
    )
    cloud_axes: list[str] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="Which of the cloud's axes are the camera's x (right), y (down), z (ahead).",
        examples=[["x", "-y", "-z"]],
    )
    depth_scale_mm: float | None = Field(
        default=None, gt=0, description="Of a depth image in place of a cloud: mm a step."
    )

    def form(self) -> CaptureForm:
        """Return the same, for what reads the files."""
        about = self.model_dump()
        axes = about["cloud_axes"]
        return CaptureForm(**{**about, "cloud_axes": None if axes is None else tuple(axes)})


class CaptureAbout(Posed):
    """What is known of a capture beside its files."""

    view: str | None = Field(default=None, min_length=1, max_length=255, description="Its view.")
    exposure_ms: float | None = Field(
        default=None, gt=0, description="Exposure time as read back, ms.", examples=[12.5]
    )
    files: FileForm = Field(default=FileForm(), description="What its files do not tell.")


@dataclass(frozen=True)
class Upload:
    """What came with a multipart request: a description in JSON, an image and a cloud."""

    about: bytes
    image: UploadFile
    cloud: UploadFile


@asynccontextmanager
async def uploaded(request: Request) -> AsyncIterator[Upload]:
    """Read the parts of a multipart request; their files are removed at the end.

    Raises
    ------
    InputError
        If a part is missing, or there is another.
    """
    async with request.form(max_files=2, max_fields=1, max_part_size=_MOST_ABOUT) as form:
        yield Upload(_about(form), _file(form, "image"), _file(form, "cloud"))


def _about(form: FormData) -> bytes:
    given = form.get("about")
    if not isinstance(given, str):
        msg = "the part 'about' is missing: a JSON object with what the files do not tell"
        raise InputError(msg)
    return given.encode("utf-8", "surrogatepass")


def _file(form: FormData, name: str) -> UploadFile:
    given = form.get(name)
    if not isinstance(given, UploadFile):
        msg = f"the part {name!r} is missing: send the capture's {name} as a file"
        raise InputError(msg)
    return given


@contextmanager
def upload_folder() -> Iterator[Path]:
    """Make a folder for files that are read and forgotten; errors do not tell where it was."""
    with tempfile.TemporaryDirectory(prefix="exposight-upload-") as name:
        try:
            yield Path(name)
        except ExposightError as error:
            raise error.named(str(error).replace(f"{name}/", "")) from error


def read_upload(
    upload: Upload, about: CaptureAbout, sensor: cell.ActiveSensor, folder: Path, limits: Limits
) -> dict[str, Any]:
    """Return an upload's image and cloud, and what they are, as a `Capture` takes them.

    Raises
    ------
    ExposightError
        If one of them cannot be read.
    RequestError
        413 if a picture announces more pixels than are taken.
    """
    form = about.files.form()
    image, cloud = _written(upload.image, folder, "image"), _written(upload.cloud, folder, "cloud")
    for path in (image, cloud) if cell.is_depth_image(cloud) else (image,):
        _check_pixels(path, limits)
    return {
        "image": form.image(image),
        "cloud": _packed_cloud(cloud, about.files, limits)
        if cloud.suffix.lower() == ".npz"
        else form.cloud(cloud, sensor),
        "bit_depth": form.bit_depth,
        "brightness_source": form.brightness_source,
    }


def exposure_of(about: CaptureAbout) -> float:
    """Return the exposure time of a capture, ms.

    Raises
    ------
    InputError
        If it is not given.
    """
    if about.exposure_ms is None:
        msg = "exposure_ms is missing: the exposure time of the capture, as read back"
        raise InputError(msg)
    return about.exposure_ms


def _written(file: UploadFile, folder: Path, name: str) -> Path:
    """Write a part to a file; of the client's name only the ending is kept, if it is plain."""
    ending = re.search(r"\.[A-Za-z0-9]{1,8}\Z", file.filename or "")
    path = folder / f"{name}{ending.group() if ending else ''}"
    with path.open("wb") as target:
        shutil.copyfileobj(file.file, target)
    return path


def _packed_cloud(path: Path, form: FileForm, limits: Limits) -> cell.Cloud:
    """Read a cloud as campaigns' folders hold it, in which a missing point costs a bit."""
    given = [name for name in _OF_CLOUDS if getattr(form, name) is not None]
    if given:
        msg = (
            f"files.{given[0]} is not for NPZ clouds: as campaigns hold them, in mm and in the "
            "camera's axes; leave it out, or send another format"
        )
        raise InputError(msg)
    data = read_bytes(path, "cloud")
    arrays = read_arrays(data, path, "cloud of a capture", most_bytes=len(data))
    points = arrays["valid"].size * 8 if "valid" in arrays else 0
    if points > limits.points:
        msg = f"{path.name}: {points} points; up to {limits.points} are taken"
        raise RequestError(413, msg)
    return cloud_from_npz(data, path)


def _check_pixels(path: Path, limits: Limits) -> None:
    pixels = announced_pixels(read_bytes(path, "image"))
    if pixels is not None and pixels > limits.pixels:
        msg = (
            f"{path.name}: an image of {pixels / 1e6:.1f} million pixels; up to "
            f"{limits.pixels / 1e6:g} million are taken (--max-megapixels)"
        )
        raise RequestError(413, msg)
