"""Decoded maps as files: NumPy archives that other programs read (docs/formats.md)."""

import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError
from exposight.files import read_bytes, write_durably
from exposight.imaging.decoded import DecodedMap

_FORMAT = "exposight decoded map"
_VERSION = 1
_DAMAGED = (zipfile.BadZipFile, zlib.error)


def write_map(path: str | Path, decoded: DecodedMap) -> None:
    """Write a decoded map as an ``.npz`` archive.

    Parameters
    ----------
    path : path
        The file; it is whole or absent.
    decoded : DecodedMap
        Its contradictions are not kept.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    axes: dict[str, Any] = {"column": decoded.column, "row": decoded.row}
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        format=np.array(_FORMAT),
        version=np.array(_VERSION),
        projector_size=np.array([decoded.projector_width, decoded.projector_height]),
        exposure_ms=np.array(np.nan if decoded.exposure_ms is None else decoded.exposure_ms),
        emulated=np.array(decoded.emulated),
        modulation=decoded.modulation,
        flags=decoded.flags,
        **{name: array for name, array in axes.items() if array is not None},
    )
    write_durably(Path(path), buffer.getvalue())


def read_map(path: str | Path) -> DecodedMap:
    """Read a decoded map that `write_map` wrote.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is no decoded map, of a later version, damaged, or its arrays do not fit together.
    """
    data = read_bytes(Path(path), "decoded map")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, TypeError, AttributeError, OSError, EOFError, *_DAMAGED) as error:
        msg = f"{path}: damaged, or no NumPy archive of a decoded map ({error})"
        raise FormatError(msg) from error
    if str(arrays.get("format")) != _FORMAT:
        msg = f"{path}: expected the format '{_FORMAT}', got {arrays.get('format')}"
        raise FormatError(msg)
    version = arrays.get("version")
    if version is None or version.shape or int(version) != _VERSION:
        msg = f"{path}: expected version {_VERSION} of a decoded map, got {version}"
        raise FormatError(msg)
    for name in ("projector_size", "exposure_ms", "emulated"):
        if name not in arrays:
            msg = f"{path}: the decoded map lacks {name}"
            raise FormatError(msg)
    flags = _array(arrays, "flags", np.uint8, None, path)
    shape = flags.shape
    coordinates = {
        name: _array(arrays, name, np.float64, shape, path)
        for name in ("column", "row")
        if name in arrays
    }
    if not coordinates or flags.ndim != 2 or arrays["projector_size"].shape != (2,):
        msg = (
            f"{path}: expected column, row or both of shape (rows, columns) and two numbers as "
            f"projector_size, got {sorted(arrays)} of shape {shape}"
        )
        raise FormatError(msg)
    exposure_ms = float(arrays["exposure_ms"])
    width, height = arrays["projector_size"].tolist()
    return DecodedMap(
        column=coordinates.get("column"),
        row=coordinates.get("row"),
        modulation=_array(arrays, "modulation", np.float32, shape, path),
        flags=flags,
        projector_width=int(width),
        projector_height=int(height),
        exposure_ms=None if np.isnan(exposure_ms) else exposure_ms,
        emulated=bool(arrays["emulated"]),
    )


def _array(
    arrays: dict[str, NDArray[Any]],
    name: str,
    dtype: type,
    shape: tuple[int, ...] | None,
    path: str | Path,
) -> NDArray[Any]:
    array = arrays.get(name)
    if array is None or array.dtype != dtype or (shape is not None and array.shape != shape):
        expected = f"{np.dtype(dtype)}" + (f" of shape {shape}" if shape else "")
        got = "none" if array is None else f"{array.dtype} of shape {array.shape}"
        msg = f"{path}: expected {name} as {expected}, got {got}"
        raise FormatError(msg)
    return array
