"""The car door: built once, then read from a cache.

The cache is a file of our own, so whatever is wrong with it (damaged, of another design, not
writable) costs a few seconds of building and never an error.
"""

from __future__ import annotations

import hashlib
import io
import logging
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from exposight.cell import Part
from exposight.errors import FileError
from exposight.files import write_durably
from exposight.twin.part.door_shape import DOOR, DOOR_MESH, OUTSIDE_ZONES
from exposight.twin.part.scene import Scene, check_scene
from exposight.twin.part.sheet_mesh import mesh_sheet
from exposight.twin.part.surfaces import FINISHES

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


logger = logging.getLogger(__name__)

CACHE_VARIABLE = "EXPOSIGHT_CACHE"
"""Environment variable that names another cache folder."""

_VERSION = 1
"""To be raised when the same design gives another mesh."""

_ARRAYS = ("vertices", "faces", "face_finish")


def build_door(progress: Callable[[int, int], None] | None = None) -> Scene:
    """Build the door from its design; the same one every time.

    Parameters
    ----------
    progress : callable, optional
        Called with (steps done, steps in all).

    Returns
    -------
    Scene
        Watertight, about 1.2 million triangles; the inside bare, the outside in three zones.
    """
    mesh = mesh_sheet(DOOR, DOOR_MESH, progress)
    x_mm = mesh.vertices[mesh.faces, 0].mean(axis=1)
    borders = [border for border, _ in OUTSIDE_ZONES[:-1]]
    zone_finish = np.array([FINISHES.index(finish) for _, finish in OUTSIDE_ZONES], dtype=np.uint8)
    bare = np.uint8(FINISHES.index("bare"))
    finish = np.where(mesh.outer, zone_finish[np.searchsorted(borders, x_mm, side="right")], bare)
    return check_scene(
        Scene(vertices=mesh.vertices, faces=mesh.faces, face_finish=finish, part=door_part())
    )


def door(cache: Path | None = None, progress: Callable[[int, int], None] | None = None) -> Scene:
    """Return the door, from the cache where it is there and whole.

    Parameters
    ----------
    cache : Path, optional
        Folder of the cache; default is `cache_folder`.
    progress : callable, optional
        Called with (steps done, steps in all) if the door has to be built.

    Returns
    -------
    Scene
        As `build_door` makes it.
    """
    fingerprint = _fingerprint()
    path = Path(cache or cache_folder()) / f"door-{fingerprint[:16]}.npz"
    scene = _read(path, fingerprint)
    if scene is None:
        scene = build_door(progress)
        _write(path, fingerprint, scene)
    return scene


def cache_folder() -> Path:
    """Return the folder of exposight's cache: `CACHE_VARIABLE`, or the platform's own place."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "exposight"
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
        return Path(local) / "exposight" / "Cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "exposight"


def door_part() -> Part:
    """Return the door with its 35 features; no mesh is needed for it."""
    return Part(name="door", features=tuple(map(DOOR.feature, DOOR.holes)))


def _fingerprint() -> str:
    """Return a checksum of all that decides how the mesh comes out."""
    decided = (_VERSION, DOOR, DOOR_MESH, OUTSIDE_ZONES)
    return hashlib.sha256(repr(decided).encode()).hexdigest()


def _checksum(fingerprint: str, arrays: dict[str, NDArray[np.generic]]) -> str:
    digest = hashlib.sha256(fingerprint.encode())
    for name in _ARRAYS:
        digest.update(np.ascontiguousarray(arrays[name]).data)
    return digest.hexdigest()


def _read(path: Path, fingerprint: str) -> Scene | None:
    """Read a cached door; None where it is missing, or is not exactly what was written."""
    if not path.is_file():
        return None
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in _ARRAYS}
            checksum = str(archive["sha256"])
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        logger.warning("the cached door %s cannot be read (%s); it is built again", path, error)
        return None
    if checksum != _checksum(fingerprint, arrays):
        logger.warning("the cached door %s is damaged; it is built again", path)
        return None
    return Scene(**arrays, part=door_part())


def _write(path: Path, fingerprint: str, scene: Scene) -> None:
    arrays = {name: getattr(scene, name) for name in _ARRAYS}
    buffer = io.BytesIO()
    np.savez(buffer, **arrays, sha256=np.array(_checksum(fingerprint, arrays)))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, buffer.getvalue())
    except (OSError, FileError) as error:
        logger.warning("the door could not be cached (%s); it is built again next time", error)
