"""Decoded maps as files: NumPy archives that other programs read (docs/formats.md)."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.cell import GREY_MAX
from exposight.errors import FormatError
from exposight.files import parsing, read_arrays, read_bytes, write_durably
from exposight.imaging.decoded import DecodedMap, PixelFlag

_FORMAT = "exposight decoded map"
_VERSION = 1
_MOST_PROJECTOR_PIXELS = 100_000


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
    arrays = read_arrays(data, path, "decoded map", kinds="biufU")
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
    with parsing(path, "decoded map"):
        exposure_ms = float(arrays["exposure_ms"])
        width, height = arrays["projector_size"].tolist()
        emulated = bool(arrays["emulated"])
    decoded = DecodedMap(
        column=coordinates.get("column"),
        row=coordinates.get("row"),
        modulation=_array(arrays, "modulation", np.float32, shape, path),
        flags=flags,
        projector_width=int(width),
        projector_height=int(height),
        exposure_ms=None if np.isnan(exposure_ms) else exposure_ms,
        emulated=emulated,
    )
    if fault := _fault(decoded):
        msg = f"{path}: {fault}; decode the frames again"
        raise FormatError(msg)
    return decoded


def _fault(decoded: DecodedMap) -> str:
    """Say what no decoding yields; empty where nothing does."""
    size = decoded.projector_width, decoded.projector_height
    if not all(0 < pixels <= _MOST_PROJECTOR_PIXELS for pixels in size):
        return f"expected a projector of 1 to {_MOST_PROJECTOR_PIXELS} px a side, got {size}"
    if decoded.exposure_ms is not None and not 0.0 < decoded.exposure_ms < np.inf:
        return f"expected an exposure time above 0 ms, got {decoded.exposure_ms:g}"
    if not ((decoded.modulation >= 0.0) & (decoded.modulation <= GREY_MAX)).all():
        return f"expected modulations from 0 to {GREY_MAX}"
    if (decoded.flags > sum(PixelFlag)).any():
        return f"expected flags of {', '.join(f'{flag:d}' for flag in PixelFlag)}"
    axes = [each for each in (decoded.column, decoded.row) if each is not None]
    if any(np.isinf(each).any() for each in axes):
        return "expected finite coordinates, or NaN where there is none"
    return ""


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
