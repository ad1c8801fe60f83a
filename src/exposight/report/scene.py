"""3D scenes: how a camera's axes (x right, y down, z forward) are laid into plotly's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exposight.report.colours import GRID

if TYPE_CHECKING:
    from numpy.typing import NDArray


def coordinates(points: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Lay the camera's axes into plotly's, whose z is up: its y is depth, its z the image's v."""
    return {"x": points[:, 0], "y": points[:, 2], "z": points[:, 1]}


def scene(
    points: NDArray[np.float32], camera: dict[str, Any], *, depth_ticks: int = 3
) -> dict[str, Any]:
    """Return a scene that holds (n, 3) points in mm, to scale, its axes with units.

    Parameters
    ----------
    points : (n, 3) ndarray, mm
        x right, y down, z away from the viewer.
    camera : dict
        Plotly's, from where the scene is seen at first.
    depth_ticks : int
        About how many ticks the axis of depth has.
    """
    low, high = (edge.astype(np.float64).tolist() for edge in (points.min(0), points.max(0)))
    size = [max(top - bottom, 1.0) for bottom, top in zip(low, high, strict=True)]
    x, y, z = ([bottom, bottom + own] for bottom, own in zip(low, size, strict=True))
    longest = max(size)
    return {
        "xaxis": _axis("x (mm)", x),
        "yaxis": _axis("z (mm), depth", z, ticks=depth_ticks),
        "zaxis": _axis("y (mm), down", y[::-1]),
        "aspectmode": "manual",
        "aspectratio": {
            "x": size[0] / longest,
            "y": size[2] / longest,
            "z": size[1] / longest,
        },
        "camera": camera,
        "dragmode": "turntable",
    }


def _axis(title: str, limits: list[float], ticks: int = 6) -> dict[str, Any]:
    return {
        "title": {"text": title},
        "range": limits,
        "nticks": ticks,
        "showbackground": False,
        "gridcolor": GRID,
        "zeroline": False,
        "showspikes": False,
    }
