"""Where rays meet a scene, by Embree.

`embreex` is called directly: it answers with distance, normal and place in the triangle at once,
five times quicker than through trimesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.twin.part import Scene


MISS_MM = 1e30
"""Distances beyond this mean that the ray met nothing: Embree answers 1e37."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hits:
    """Where n rays meet the scene first.

    Parameters
    ----------
    distance : (n,) ndarray of float32
        In units of the ray's direction; above `MISS_MM` where nothing is met.
    face : (n,) ndarray of int32
        The triangle, −1 where nothing is met.
    u, v : (n,) ndarray of float32
        Barycentric coordinates of its second and third corner.
    normal : (n, 3) ndarray of float32
        Its normal, not normalised.
    """

    distance: NDArray[np.float32]
    face: NDArray[np.int32]
    u: NDArray[np.float32]
    v: NDArray[np.float32]
    normal: NDArray[np.float32]


class SceneTracer:
    """A scene made ready for rays: build it once, trace many views.

    Parameters
    ----------
    scene : Scene
        What light falls on.
    """

    def __init__(self, scene: Scene) -> None:
        self.faces = scene.faces
        self.face_finish = scene.face_finish
        self.vertex_normals = np.ascontiguousarray(scene.normals(), dtype=np.float32)
        self._embree = EmbreeScene()
        vertices = np.ascontiguousarray(scene.vertices, dtype=np.float32)
        self._mesh = TriangleMesh(self._embree, vertices, scene.faces)

    def first_hits(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """Find what rays meet first.

        Parameters
        ----------
        origins, directions : (n, 3) ndarray of float32, mm
            In the part's frame; a direction need not have length 1. One of length 0 meets
            nothing; NaN must be kept out.
        """
        found = self._embree.run(origins, directions, output=1)
        return Hits(
            distance=found["tfar"],
            face=found["primID"],
            u=found["u"],
            v=found["v"],
            normal=found["Ng"],
        )

    def blocked(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Tell which (n,) rays meet something before the end of their direction vectors."""
        if not len(origins):
            return np.zeros(0, dtype=np.bool_)
        ends = np.full(len(origins), 0.9999, dtype=np.float32)
        found = self._embree.run(origins, directions, dists=ends, query="OCCLUDED")
        return np.asarray(found != -1)
