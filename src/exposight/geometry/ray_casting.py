"""Where rays meet a mesh.

Rays are traced by Embree. `embreex` is called directly: it answers with distance, normal and place
in the triangle at once, five times quicker than through trimesh.
"""

from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

MISS_MM = 1e30
"""Distances beyond this mean that the ray met nothing: Embree answers 1e37."""


class RayCaster:
    """Triangles made ready for rays: build it once, cast many.

    Parameters
    ----------
    vertices : (n, 3) ndarray, mm
        In the part's frame.
    faces : (m, 3) ndarray of int32
        Corners of the triangles, in any orientation.
    """

    def __init__(self, vertices: NDArray[np.floating[Any]], faces: NDArray[np.int32]) -> None:
        self._embree = EmbreeScene()
        self._mesh = TriangleMesh(
            self._embree, np.ascontiguousarray(vertices, dtype=np.float32), faces
        )

    def first_hits(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Find what n rays meet first.

        Parameters
        ----------
        origins, directions : (n, 3) ndarray of float32, mm
            In the part's frame; a direction need not have length 1. One of length 0 meets
            nothing; NaN must be kept out.

        Returns
        -------
        distance : (n,) ndarray of float32
            In units of the ray's direction; above `MISS_MM` where nothing is met.
        face : (n,) ndarray of int32
            The triangle, −1 where nothing is met.
        u, v : (n,) ndarray of float32
            Barycentric coordinates of its second and third corner.
        normal : (n, 3) ndarray of float32
            Its normal, not normalised.
        """
        hits = self._embree.run(origins, directions, output=1)
        return hits["tfar"], hits["primID"], hits["u"], hits["v"], hits["Ng"]

    def blocked(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Tell which (n,) rays meet something before the end of their direction vectors."""
        if not len(origins):
            return np.zeros(0, dtype=np.bool_)
        ends = np.full(len(origins), 0.9999, dtype=np.float32)
        face = self._embree.run(origins, directions, dists=ends, query="OCCLUDED")
        return np.asarray(face != -1)
