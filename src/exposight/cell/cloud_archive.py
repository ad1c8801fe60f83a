"""A capture's cloud as it is stored: an archive in which a missing point costs a bit."""

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight import files
from exposight.cell.cloud import Cloud
from exposight.errors import CloudError, FormatError

_MOST_POINTS = 10**8


def npz_of(cloud: Cloud) -> bytes:
    """Pack a cloud as its shape, its valid bits and its valid points: missing points cost a bit."""
    buffer = io.BytesIO()
    arrays = {
        "shape": np.array(cloud.valid.shape, dtype=np.int64),
        "valid": np.packbits(cloud.valid),
        "points": cloud.valid_points,
    }
    if cloud.sigma_z_mm is not None:
        arrays["sigma_z_mm"] = cloud.sigma_z_mm[cloud.valid]
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def cloud_from_npz(data: bytes, path: Path) -> Cloud:
    """Return the cloud that `npz_of` packed.

    Raises
    ------
    FormatError
        If it is anything that `npz_of` does not pack.
    """
    what = "cloud of a capture"
    # It is not compressed, so it holds no more than its bytes.
    arrays = files.read_arrays(data, path, what, most_bytes=len(data))
    with files.parsing(path, what):
        try:
            return _unpacked_cloud(**arrays)
        except (CloudError, TypeError) as error:
            msg = f"{path} is no {what} ({error}); expected shape, valid bits and points"
            raise FormatError(msg) from error


def _unpacked_cloud(
    *,
    shape: NDArray[Any],
    valid: NDArray[Any],
    points: NDArray[Any],
    sigma_z_mm: NDArray[Any] | None = None,
) -> Cloud:
    """Return what `npz_of` packed, checked as strictly as it packs."""
    size = tuple(shape.tolist()) if shape.ndim == 1 and shape.dtype.kind in "iu" else ()
    count = math.prod(size)
    if len(size) not in {1, 2} or min(size) < 0 or count > _MOST_POINTS:
        msg = f"its shape is {shape.tolist()}; clouds have up to {_MOST_POINTS} points"
        raise CloudError(msg)
    if valid.dtype != np.uint8 or valid.shape != (-(-count // 8),):
        msg = f"{count} points need as many valid bits, got {valid.dtype} of shape {valid.shape}"
        raise CloudError(msg)
    is_there = np.unpackbits(valid, count=count).astype(bool)
    n_valid = int(np.count_nonzero(is_there))
    for name, array, wanted in (
        ("points", points, (n_valid, 3)),
        ("sigma_z_mm", sigma_z_mm, (n_valid,)),
    ):
        if array is not None and (array.shape != wanted or array.dtype != np.float32):
            msg = f"{name} must be float32 of shape {wanted}, got {array.dtype} of {array.shape}"
            raise CloudError(msg)
    placed = np.full((count, 3), np.nan, dtype=np.float32)
    placed[is_there] = points
    sigma = None
    if sigma_z_mm is not None:
        sigma = np.full(count, np.nan, dtype=np.float32)
        sigma[is_there] = sigma_z_mm
        sigma = sigma.reshape(size)
    cloud = Cloud(points=placed.reshape(*size, 3), sigma_z_mm=sigma)
    if cloud.n_valid != n_valid:
        msg = f"{n_valid} points are said to be there, and {cloud.n_valid} are points"
        raise CloudError(msg)
    return cloud
