"""The paper's way of counting: trimesh's containment test with a mesh of the hollow cylinder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from exposight.observing import FeatureView

_SECTIONS = 128  # facets: the mesh's chords lie within 0.01 mm of the cylinder at 30 mm radius


class TrimeshSearch:
    """Counts the points of the same pixels that our search looks at (Sect. 3.1.3 of the paper).

    Parameters
    ----------
    points : (rows, columns, 3) ndarray of float32, mm
        Organised cloud.
    """

    def __init__(self, points: NDArray[np.float32]) -> None:
        self._points = points

    def count(self, views: Sequence[FeatureView]) -> NDArray[np.int64]:
        """Return n_points of each view."""
        return np.array([self._count(view) for view in views], dtype=np.int64)

    def _count(self, view: FeatureView) -> int:
        box, region = view.search_box, view.region
        near = self._points[box.top : box.bottom, box.left : box.right].reshape(-1, 3)
        mesh = trimesh.creation.annulus(
            r_min=region.inner_mm,
            r_max=region.outer_mm,
            height=region.height_mm,
            sections=_SECTIONS,
            transform=view.camera_from_feature.to_matrix(),
        )
        return int(np.count_nonzero(mesh.contains(near[np.isfinite(near[:, 0])])))
