"""Light that comes by way of one other surface, on every fourth pixel.

From every point seen, rays go out evenly over the cosine-weighted hemisphere; what they meet shines
there as the projector lights it. Both reflections use the full reflectance, so that bare metal
throws its glare. The result is smoothed over neighbours of like depth and spread over the pixels
between. Fine stripes light the bounce evenly by half (separation of direct and global light: Nayar
et al., SIGGRAPH 2006), so only its fully lit value is needed.

The directions are a fixed set, turned by a hash of the pixel: the same on every run, and whichever
part of the image is traced.
"""

import math
from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.geometry import PixelBox
from exposight.twin.light.optics import SceneTracer
from exposight.twin.light.shading import NUDGE_MM, Lamp, LitHits, light_along_rays
from exposight.twin.part.reflectance import reflectance, row, tangents, unit
from exposight.twin.random_numbers import mix_bits, stream_key

GRID_PX = 4
"""Every how many pixels indirect light is traced: it changes slowly."""
_FIRST_PX = 2
"""Row and column of the first pixel that is."""
_SIDE = 4  # 4 × 4 directions
_SMOOTH = 2
"""Nodes to each side that are averaged: 25 nodes of 16 rays."""
_SAME_SURFACE_MM = 8.0
"""Nodes whose depth differs by less belong to one surface: two nodes are 1 mm apart, so even their
second neighbours at a slope of 60° do."""
_BAND_NODES = 16384  # times 16 rays: bounds the memory
_KEY = stream_key(0xB0_04CE)


def _nodes_of(first: int, stop: int, size: int) -> tuple[int, int]:
    """Return the range of nodes that the pixels first … stop − 1 of an axis need."""
    count = max(1, -(-(size - _FIRST_PX) // GRID_PX))
    low = (first - _FIRST_PX) // GRID_PX - _SMOOTH
    high = (stop - 1 - _FIRST_PX) // GRID_PX + 1 + _SMOOTH + 1
    return min(max(low, 0), count - 1), max(min(high, count), 1)


def bounce(
    tracer: SceneTracer,
    lamp: Lamp,
    eye_rays: Callable[
        [NDArray[np.int64], NDArray[np.int64]], tuple[NDArray[np.float32], NDArray[np.float32]]
    ],
    depth_mm: NDArray[np.float32],
    box: PixelBox,
    image_shape: tuple[int, int],
) -> NDArray[np.float32]:
    """Return the radiance that one bounce of the fully lit projector adds to every pixel.

    Parameters
    ----------
    tracer : SceneTracer
        The scene.
    lamp : Lamp
        The projector.
    eye_rays : callable
        Returns origins and directions (n, 3) of the rays of n pixels (rows, columns).
    depth_mm : (rows, columns) ndarray of float32, mm
        Of the pixels in the box; NaN where nothing is seen.
    box : PixelBox
        The pixels wanted.
    image_shape : (int, int)
        Rows and columns of the whole image.

    Returns
    -------
    (rows, columns) ndarray of float32, 1/mm²
    """
    top, bottom = _nodes_of(box.top, box.bottom, image_shape[0])
    left, right = _nodes_of(box.left, box.right, image_shape[1])
    radiance = np.zeros((bottom - top, right - left), dtype=np.float32)
    depth = np.empty_like(radiance)
    columns = np.minimum(np.arange(left, right) * GRID_PX + _FIRST_PX, image_shape[1] - 1)
    step = max(1, _BAND_NODES // max(1, columns.size))
    for start in range(top, bottom, step):
        rows = np.arange(start, min(start + step, bottom)) * GRID_PX + _FIRST_PX
        rows = np.minimum(rows, image_shape[0] - 1)
        grid = np.meshgrid(rows, columns, indexing="ij")
        origins, directions = eye_rays(grid[0].ravel(), grid[1].ravel())
        seen = light_along_rays(tracer, lamp, origins, directions, with_grain=False)
        pixel = (grid[0] * image_shape[1] + grid[1]).ravel().astype(np.uint64)
        band = slice(start - top, start - top + rows.size)
        depth[band] = seen.distance.reshape(rows.size, -1)
        radiance[band] = _gathered(tracer, lamp, seen, directions, pixel).reshape(rows.size, -1)
    full = np.zeros(depth_mm.shape, dtype=np.float32)
    _spread(_smoothed(radiance, depth), depth, depth_mm, box.top, box.left, top, left, full)
    return full


def _gathered(
    tracer: SceneTracer,
    lamp: Lamp,
    seen: LitHits,
    directions: NDArray[np.float32],
    pixel: NDArray[np.uint64],
) -> NDArray[np.float32]:
    result = np.zeros(len(pixel), dtype=np.float32)
    on_part = np.flatnonzero(np.isfinite(seen.distance))
    if not on_part.size:
        return result
    n_rays = on_part.size * _SIDE * _SIDE
    out_origins = np.empty((n_rays, 3), dtype=np.float32)
    out_directions = np.empty((n_rays, 3), dtype=np.float32)
    normals, positions = seen.normal[on_part], seen.position_mm[on_part]
    _scatter(positions, normals, pixel[on_part], out_origins, out_directions)
    other = light_along_rays(tracer, lamp, out_origins, out_directions, with_grain=False)
    result[on_part] = _received(
        other.radiance,
        out_directions,
        normals,
        directions[on_part],
        seen.finish[on_part],
        tracer.surfaces,
    )
    return result


@njit(parallel=True, error_model="numpy")
def _scatter(
    positions: NDArray[np.float32],
    normals: NDArray[np.float32],
    pixel: NDArray[np.uint64],
    origins: NDArray[np.float32],
    directions: NDArray[np.float32],
) -> None:
    """Fill 16 stratified, cosine-weighted rays for every point."""
    count = _SIDE * _SIDE
    for i in numba.prange(len(positions)):
        normal = unit(row(normals, i))
        along, across = tangents(normal, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        for s in range(count):
            bits = mix_bits(_KEY, pixel[i] * np.uint64(count) + np.uint64(s))
            jitter_a = np.float64(np.int64(bits >> np.uint64(40))) / (1 << 24)
            jitter_b = np.float64(np.int64(bits & np.uint64((1 << 24) - 1))) / (1 << 24)
            share = (s // _SIDE + jitter_a) / _SIDE  # of sin²θ: cosine-weighted
            angle = 2.0 * math.pi * (s % _SIDE + jitter_b) / _SIDE
            sine, cosine = math.sqrt(share), math.sqrt(max(1.0 - share, 0.0))
            a, b = sine * math.cos(angle), sine * math.sin(angle)
            for j in range(3):
                ray = a * along[j] + b * across[j] + cosine * normal[j]
                directions[i * count + s, j] = ray
                origins[i * count + s, j] = positions[i, j] + NUDGE_MM * normal[j]


@njit(parallel=True, error_model="numpy")
def _received(
    shining: NDArray[np.float32],
    directions: NDArray[np.float32],
    normals: NDArray[np.float32],
    eye_directions: NDArray[np.float32],
    finish: NDArray[np.uint8],
    table: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return π/n · Σ f_r · L: what cosine-weighted rays bring to the eye."""
    count = _SIDE * _SIDE
    result = np.zeros(len(normals), dtype=np.float32)
    for i in numba.prange(len(normals)):
        normal = row(normals, i)
        eye = row(eye_directions, i)
        to_eye = unit((-eye[0], -eye[1], -eye[2]))
        total = 0.0
        for s in range(i * count, (i + 1) * count):
            if shining[s] > 0.0:
                f_r = reflectance(table[finish[i]], normal, row(directions, s), to_eye)
                total += f_r * shining[s]
        result[i] = math.pi * total / count
    return result


@njit(parallel=True, error_model="numpy")
def _smoothed(radiance: NDArray[np.float32], depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Average every node with its neighbours of like depth."""
    rows, columns = radiance.shape
    result = np.zeros_like(radiance)
    for r in numba.prange(rows):
        for c in range(columns):
            total, weight = 0.0, 0
            for i in range(max(r - _SMOOTH, 0), min(r + _SMOOTH + 1, rows)):
                for j in range(max(c - _SMOOTH, 0), min(c + _SMOOTH + 1, columns)):
                    if abs(depth[i, j] - depth[r, c]) < _SAME_SURFACE_MM:  # False for NaN
                        total += radiance[i, j]
                        weight += 1
            if weight:
                result[r, c] = total / weight
    return result


@njit(parallel=True, error_model="numpy")
def _spread(
    nodes: NDArray[np.float32],
    node_depth: NDArray[np.float32],
    depth: NDArray[np.float32],
    first_row: int,
    first_column: int,
    top: int,
    left: int,
    full: NDArray[np.float32],
) -> None:
    """Interpolate between the nodes round every pixel that have its depth."""
    for r in numba.prange(full.shape[0]):
        y = (first_row + r - _FIRST_PX) / GRID_PX - top
        for c in range(full.shape[1]):
            x = (first_column + c - _FIRST_PX) / GRID_PX - left
            i, j = math.floor(y), math.floor(x)
            total, weight = 0.0, 0.0
            for di in range(2):
                for dj in range(2):
                    a = min(max(i + di, 0), nodes.shape[0] - 1)
                    b = min(max(j + dj, 0), nodes.shape[1] - 1)
                    if abs(node_depth[a, b] - depth[r, c]) < _SAME_SURFACE_MM:
                        w = (1.0 - abs(y - i - di)) * (1.0 - abs(x - j - dj)) + 1e-6
                        total += w * nodes[a, b]
                        weight += w
            if weight > 0.0:
                full[r, c] = total / weight
