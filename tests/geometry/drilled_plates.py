"""Plates with holes, slots, pockets and pins as triangles, without a CAD kernel.

Each hole has a square cell; rims have the cell's rays, so that cells share their borders' corners.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from exposight.geometry.meshes.triangle_meshes import Mesh

CELL = 40.0
THICK = 10.0


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell's feature: rows of (radius − r, z) from the upper rim on, then a lower rim or a cap.

    A slot has a half straight length and a direction; a pin goes up.
    """

    radius: float = 5.0
    straight: float = 0.0
    direction: float = 0.0
    profile: Sequence[tuple[float, float]] = field(default=((0.0, 0.0), (0.0, -THICK)))
    closed: bool = False

    def rim(self, angles: np.ndarray, grow: float) -> np.ndarray:
        """Points at polar angles on the outline, grown."""
        r, s = self.radius + grow, self.straight
        turned = angles - self.direction
        c, n = np.abs(np.cos(turned)), np.abs(np.sin(turned))
        on_side = s * n >= r * c  # tan ≥ r / s
        ray = np.where(
            on_side & (n > 0),
            r / np.maximum(n, 1e-12),
            s * c + np.sqrt(np.maximum(r**2 - (s * n) ** 2, 0)),
        )
        return ray[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


HOLE = Cell()
BLIND = Cell(profile=((0, 0), (0, -6)), closed=True)
PIN = Cell(profile=((0, 0), (0, 8)), closed=True)


def plate(cells: Sequence[Cell], corners: int = 32, open_sheet: bool = False) -> Mesh:
    """A row of cells along x as one mesh, a solid or its upper side alone; triangle soup."""
    angles = 2 * math.pi * np.arange(corners) / corners
    direction = np.column_stack([np.cos(angles), np.sin(angles)])
    square = direction / np.abs(direction).max(axis=1, keepdims=True) * (CELL / 2)
    triangles = []

    def strip(upper: np.ndarray, lower: np.ndarray) -> None:
        """Triangles between rings that run anticlockwise; the normals of an inner wall."""
        up, down = np.roll(upper, -1, axis=0), np.roll(lower, -1, axis=0)
        triangles.append(np.stack([upper, up, lower], axis=1))
        triangles.append(np.stack([up, down, lower], axis=1))

    def ring(points: np.ndarray, z: float) -> np.ndarray:
        return np.column_stack([points, np.full(len(points), float(z))])

    for number, cell in enumerate(cells):
        start = sum(len(each) for each in triangles)
        rings = [ring(cell.rim(angles, grow), z) for grow, z in cell.profile]
        top, bottom = ring(square, 0), ring(square, -THICK)
        strip(top, rings[0])
        if not open_sheet:
            for upper, lower in itertools.pairwise(rings):
                strip(upper, lower)
            last = rings[-1]
            if cell.closed:
                centre = np.broadcast_to(last.mean(axis=0), last.shape)
                triangles.append(np.stack([last, np.roll(last, -1, axis=0), centre], axis=1))
                middle = np.broadcast_to([0.0, 0.0, -THICK], bottom.shape)
                triangles.append(np.stack([np.roll(bottom, -1, axis=0), bottom, middle], axis=1))
            else:
                strip(last, bottom)
            for side, there in enumerate((number == len(cells) - 1, True, number == 0, True)):
                if there:
                    outward = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][side])
                    on = np.isclose(square @ outward, CELL / 2)
                    both = on & np.roll(on, -1)
                    a, b = top[both], np.roll(top, -1, axis=0)[both]
                    c, d = bottom[both], np.roll(bottom, -1, axis=0)[both]
                    triangles.append(np.stack([a, c, b], axis=1))
                    triangles.append(np.stack([b, c, d], axis=1))
        moved = np.concatenate(triangles)
        moved[start:, :, 0] += number * CELL
        triangles = [moved]
    soup = np.concatenate(triangles)
    return Mesh(
        vertices=soup.reshape(-1, 3),
        faces=np.arange(3 * len(soup), dtype=np.int32).reshape(-1, 3),
    )
