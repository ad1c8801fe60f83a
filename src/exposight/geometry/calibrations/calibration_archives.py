"""Calibrations in NumPy's and MATLAB's archives, without Python objects and of bounded size."""

import io
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from exposight.geometry.calibrations.calibration_values import (
    DEEPEST,
    LARGEST_BYTES,
    SyntaxFault,
    Tree,
)


def parse_npz(data: bytes) -> Tree:
    """Return the arrays of an .npz file."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        _check_unpacked(sum(info.file_size for info in archive.infolist()))
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            content = {name: arrays[name] for name in arrays.files}
    except ValueError as error:
        if "pickle" in str(error).lower():
            msg = "it holds Python objects; save arrays alone: np.savez(…, K=K, D=D, R=R, T=T)"
            raise SyntaxFault(msg) from error
        raise
    return {name: _of_numpy(array) for name, array in content.items()}


def _of_numpy(value: Any, depth: int = 0) -> Tree:
    if isinstance(value, Mapping):
        if depth > DEEPEST:
            msg = f"it is nested more than {DEEPEST} deep"
            raise SyntaxFault(msg)
        return {str(key): _of_numpy(each, depth + 1) for key, each in value.items()}
    array = np.asarray(value)
    if array.dtype.kind in "biuf":
        return float(array) if array.ndim == 0 else array.astype(np.float64)
    if array.dtype.kind in "US":
        return str(array) if array.ndim == 0 else [str(each) for each in array.reshape(-1)]
    return f"a value of the type {array.dtype}"


def parse_mat(data: bytes) -> Tree:
    """Return the variables of a .mat file up to version 7; structures are maps."""
    # scipy takes a tenth of a second to import, and few calibrations are MATLAB's.
    from scipy.io import loadmat

    place, unpacked = 128, 0
    order = "little" if data[126:128] == b"IM" else "big"
    while place + 8 <= len(data):
        kind = int.from_bytes(data[place : place + 4], order)  # type: ignore[arg-type]
        length = int.from_bytes(data[place + 4 : place + 8], order)  # type: ignore[arg-type]
        if kind == 15:
            piece = zlib.decompressobj()
            packed = data[place + 8 : place + 8 + length]
            unpacked += len(piece.decompress(packed, 4 * LARGEST_BYTES))
            _check_unpacked(unpacked)
        place += 8 + length
    content = loadmat(io.BytesIO(data), simplify_cells=True)
    return {name: _of_numpy(value) for name, value in content.items() if not name.startswith("__")}


def _check_unpacked(size: int) -> None:
    if size >= 4 * LARGEST_BYTES:
        msg = f"{size / 1e6:.0f} MB when it is unpacked, and a calibration has a few numbers"
        raise SyntaxFault(msg)
