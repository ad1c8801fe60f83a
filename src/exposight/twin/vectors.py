"""Vectors of three numbers in compiled loops, in the part's frame."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit

Vector = tuple[float, float, float]


@njit(inline="always", error_model="numpy")
def row(a: NDArray[np.float32], i: int) -> Vector:
    """Return row i of an (n, 3) array."""
    return np.float64(a[i, 0]), np.float64(a[i, 1]), np.float64(a[i, 2])


@njit(inline="always", error_model="numpy")
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(inline="always", error_model="numpy")
def unit(a: Vector) -> Vector:
    """Return a vector of length 1 in the same direction."""
    scale = 1.0 / math.sqrt(dot(a, a))
    return a[0] * scale, a[1] * scale, a[2] * scale


@njit(inline="always", error_model="numpy")
def tangents(normal: Vector) -> tuple[Vector, Vector]:
    """Return unit vectors along and across the part's x axis in the surface with this normal."""
    x, y, z = normal
    if abs(x) < 0.9:
        along = unit((1.0 - x * x, -x * y, -x * z))
    else:
        along = unit((-x * y, 1.0 - y * y, -y * z))
    across = (
        y * along[2] - z * along[1],
        z * along[0] - x * along[2],
        x * along[1] - y * along[0],
    )
    return along, across
