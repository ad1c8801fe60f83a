"""Cuts a STEP file into triangles by cascadio, in a process of its own (`files.parse_apart`).

OpenCASCADE, which it stands on, crashes on some damaged files.
"""

from pathlib import Path
from typing import Any

import cascadio
import numpy as np


def parse(data: bytes, *, folder: str, chord_mm: str, chord_rad: str) -> dict[str, Any]:
    """Return a STEP file's triangles as a GLB file, ``glb``; empty where it has no faces.

    Parameters
    ----------
    data : bytes
        The file.
    folder : str
        Where it may be put down.
    chord_mm, chord_rad : str
        How far chords may leave a curve, and how much they may turn.
    """
    part, cut = Path(folder) / "part.step", Path(folder) / "part.glb"
    part.write_bytes(data)
    why = cascadio.step_to_glb(
        str(part), str(cut), tol_linear=float(chord_mm), tol_angular=float(chord_rad)
    )
    if why:
        msg = f"OpenCASCADE gives up: {why}"
        raise ValueError(msg)
    glb = cut.read_bytes() if cut.is_file() else b""
    return {"glb": np.frombuffer(glb, dtype=np.uint8)}
