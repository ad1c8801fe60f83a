"""One capture on disk: a folder with its description, image, cloud, and what else is kept."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import cv2
import numpy as np
from pydantic import Field

from exposight.cell.capture import (
    CLOUD_FILE,
    DESCRIPTION_FILE,
    IMAGE_FILE,
    Capture,
    CaptureKey,
)
from exposight.cell.cloud import Cloud
from exposight.cell.sensor_document import PoseMatrix, pose_from_rows, rows_from_pose
from exposight.errors import (
    DamagedFileError,
    FileError,
    FormatError,
    ImageError,
    InputError,
    MissingFileError,
)
from exposight.files.documents import StrictDocument, sealed_json, sha256_of, unseal_json
from exposight.files.durable import durable_folder

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray


CAPTURE_FORMAT = "exposight capture"
CAPTURE_VERSION = 2
"""2: a capture may lack its cloud, and have attachments."""

# A quarter of the default level's time for files a tenth larger, at 4 megapixels.
_PNG_OPTIONS = (cv2.IMWRITE_PNG_COMPRESSION, 1)

_Checksum = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
_FileName = Annotated[str, Field(pattern="^[A-Za-z0-9][A-Za-z0-9._-]*$")]  # never another folder's


class CaptureDocument(StrictDocument):
    """What ``capture.json`` says."""

    format: Literal["exposight capture"]
    version: int
    view: str
    exposure_ms: float
    bit_depth: int
    emulated: bool
    notes: str
    camera_from_part: PoseMatrix
    image_sha256: _Checksum
    cloud_sha256: _Checksum | None
    beside_sha256: dict[_FileName, _Checksum] = Field(default_factory=dict)  # not in version 1


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
    files = {**capture.attachments, IMAGE_FILE: png_bytes(capture.image)}
    if capture.cloud is not None:
        files[CLOUD_FILE] = _npz(capture.cloud)
    checksums = {name: sha256_of(content) for name, content in files.items()}
    document = CaptureDocument(
        format="exposight capture",
        version=CAPTURE_VERSION,
        view=capture.view,
        exposure_ms=capture.exposure_ms,
        bit_depth=capture.bit_depth,
        emulated=capture.emulated,
        notes=capture.notes,
        camera_from_part=rows_from_pose(capture.camera_from_part),
        image_sha256=checksums.pop(IMAGE_FILE),
        cloud_sha256=checksums.pop(CLOUD_FILE, None),
        beside_sha256=checksums,
    )
    with durable_folder(folder) as unfinished:
        for name, content in files.items():
            (unfinished / name).write_bytes(content)
        (unfinished / DESCRIPTION_FILE).write_bytes(sealed_json(document))


def read_key(folder: Path) -> CaptureKey:
    """Return the view and the exposure time of a capture without reading its image and cloud.

    Raises
    ------
    MissingFileError, DamagedFileError, FormatError, VersionError
        As `read_capture`.
    """
    document = _read_document(folder)
    return CaptureKey(document.view, document.exposure_ms)


def read_capture(folder: Path) -> Capture:
    """Read a capture and verify its checksums.

    Raises
    ------
    MissingFileError
        If the folder or one of its files is not there.
    DamagedFileError
        If a file's content is not what was written; the message names it.
    FormatError
        If the description is not one of a capture.
    VersionError
        If a newer version of exposight wrote it.
    """
    document = _read_document(folder)
    image = _image_from_png(
        _verified(folder / IMAGE_FILE, document.image_sha256), folder / IMAGE_FILE
    )
    cloud = None
    if document.cloud_sha256 is not None:
        cloud = _cloud_from_npz(
            _verified(folder / CLOUD_FILE, document.cloud_sha256), folder / CLOUD_FILE
        )
    try:
        return Capture(
            view=document.view,
            exposure_ms=document.exposure_ms,
            image=image,
            cloud=cloud,
            camera_from_part=pose_from_rows(document.camera_from_part),
            bit_depth=document.bit_depth,
            emulated=document.emulated,
            notes=document.notes,
            attachments=StoredAttachments(folder, document.beside_sha256),
        )
    except InputError as error:
        msg = f"{folder}: {error}"
        raise FormatError(msg) from error


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


def read_attachments(folder: Path) -> StoredAttachments:
    """Return the further files of a capture without reading its image and cloud.

    Raises
    ------
    MissingFileError, DamagedFileError, FormatError, VersionError
        As `read_capture`; looking up a file may raise the first two as well.
    """
    return StoredAttachments(folder, _read_document(folder).beside_sha256)


def _read_document(folder: Path) -> CaptureDocument:
    path = folder / DESCRIPTION_FILE
    return unseal_json(
        CaptureDocument,
        read_bytes(path),
        format_name=CAPTURE_FORMAT,
        newest=CAPTURE_VERSION,
        source=str(path),
    )


def read_bytes(path: Path) -> bytes:
    """Return the content of a file that belongs to a campaign.

    Raises
    ------
    MissingFileError
        If it is not there.
    FileError
        If the disk refuses.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        msg = f"{path} is missing; restore it from a copy of the campaign"
        raise MissingFileError(msg) from error
    except OSError as error:
        msg = f"{path} cannot be read: {error.strerror or error}; check the disk and permissions"
        raise FileError(msg) from error


def _verified(path: Path, sha256: str) -> bytes:
    return check_sha256(read_bytes(path), sha256, path)


def check_sha256(data: bytes, sha256: str, path: Path) -> bytes:
    """Return a file's content, whose checksum must be the one on record.

    Raises
    ------
    DamagedFileError
        If it is another.
    """
    if sha256_of(data) != sha256:
        msg = (
            f"{path} is damaged: its SHA-256 is not the one on record; restore it from a copy of "
            "the campaign, or delete the folder it is in and capture again"
        )
        raise DamagedFileError(msg)
    return data


def png_bytes(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Return a grey image as the content of a lossless PNG file.

    Raises
    ------
    ImageError
        If PNG has nothing for such an array.
    """
    done, encoded = cv2.imencode(".png", image, _PNG_OPTIONS)
    if not done:
        msg = f"an image of shape {image.shape} and type {image.dtype} cannot be written as PNG"
        raise ImageError(msg)
    return bytes(encoded.tobytes())


def _image_from_png(data: bytes, path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        msg = f"{path} is no PNG image"
        raise FormatError(msg)
    return cast("NDArray[np.uint8] | NDArray[np.uint16]", image)  # `Capture` checks it


def _npz(cloud: Cloud) -> bytes:
    """Pack a cloud as its shape, its valid bits and its valid points: missing points cost a bit."""
    buffer = io.BytesIO()
    np.savez(
        buffer,
        shape=np.array(cloud.valid.shape, dtype=np.int64),
        valid=np.packbits(cloud.valid),
        points=cloud.valid_points,
    )
    return buffer.getvalue()


def _cloud_from_npz(data: bytes, path: Path) -> Cloud:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            shape = tuple(arrays["shape"].tolist())
            valid = np.unpackbits(arrays["valid"], count=int(np.prod(shape))).astype(bool)
            points = np.full((valid.size, 3), np.nan, dtype=np.float32)
            points[valid] = arrays["points"]
            return Cloud(points=points.reshape(*shape, 3))
    except (KeyError, ValueError, TypeError, zipfile.BadZipFile, InputError) as error:
        msg = f"{path} is no cloud of a capture ({error}); expected shape, valid bits and points"
        raise FormatError(msg) from error
