"""Where rays meet a scene, by Embree.

`embreex` is called directly: it answers with distance, normal and place in the triangle at once,
five times quicker than through trimesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from exposight.errors import InputError
from exposight.twin.part import FINISHES

if TYPE_CHECKING:
    from numpy.typing import NDArray


MISS_MM = 1e30
"""Distances beyond this mean that the ray met nothing: Embree answers 1e37."""


class TracedScene(Protocol):
    """What can be traced: triangles in the part's frame, mm."""

    @property
    def vertices(self) -> NDArray[np.float64]:
        """(n, 3) mm."""
        ...

    @property
    def faces(self) -> NDArray[np.int32]:
        """(m, 3) indices of vertices."""
        ...

    @property
    def face_finish(self) -> NDArray[np.uint8]:
        """(m,) indices into `FINISHES`."""
        ...

    def normals(self) -> NDArray[np.float64]:
        """(n, 3) unit normals of the vertices."""
        ...


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
    scene : TracedScene
        Triangles in the part's frame, mm.

    Raises
    ------
    InputError
        If there are no triangles, or vertices, faces, finishes and normals do not fit together.
    """

    def __init__(self, scene: TracedScene) -> None:
        vertices, faces, finish, normals = _check_scene(scene)
        self.faces = faces
        self.face_finish = finish
        self.vertex_normals = normals
        self._embree = EmbreeScene()
        self._mesh = TriangleMesh(self._embree, vertices, faces)

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


def _check_scene(
    scene: TracedScene,
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.uint8], NDArray[np.float32]]:
    vertices = np.ascontiguousarray(scene.vertices, dtype=np.float32)
    faces = np.ascontiguousarray(scene.faces, dtype=np.int32)
    finish = np.ascontiguousarray(scene.face_finish, dtype=np.uint8)
    normals = np.ascontiguousarray(scene.normals(), dtype=np.float32)
    shapes_fit = (
        vertices.ndim == 2
        and faces.ndim == 2
        and vertices.shape[1:] == faces.shape[1:] == (3,)
        and finish.shape == faces.shape[:1]
        and normals.shape == vertices.shape
    )
    if not shapes_fit or not len(faces):
        msg = (
            "a scene needs (n, 3) vertices and normals, (m, 3) faces and (m,) finishes, m ≥ 1, "
            f"got {vertices.shape}, {normals.shape}, {faces.shape} and {finish.shape}"
        )
        raise InputError(msg)
    if not np.isfinite(vertices).all() or not np.isfinite(normals).all():
        msg = "a scene's vertices and normals must be finite; repair the mesh"
        raise InputError(msg)
    if faces.min() < 0 or faces.max() >= len(vertices):
        msg = (
            f"a scene's faces must name vertices 0 to {len(vertices) - 1}, got {faces.min()} to "
            f"{faces.max()}"
        )
        raise InputError(msg)
    if finish.max() >= len(FINISHES):
        msg = f"a face's finish is a number from 0 to {len(FINISHES) - 1}, got {finish.max()}"
        raise InputError(msg)
    return vertices, faces, finish, normals
