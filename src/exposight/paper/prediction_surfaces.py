"""Predictions over the sensor's x-y plane, at three depths and three brightnesses."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.errors import InputError
from exposight.models import GaussianProcessModel
from exposight.paper.study_settings import SensorKind

DEPTHS_MM = (-150.0, 0.0, 150.0)
"""z_tcp of the columns of Figs. 12, 24, 25 and 26."""
GREY_LEVELS = (25.0, 75.0, 125.0)
"""i_avg of their rows."""

_GRID = 33
_NEAR_MM = 45.0
"""Training poses this near to a depth are shown with it: a plane's features lie ±20 mm deep, and
its depth differs from the drawn one by up to 20 mm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionSurfaces:
    """Mean and standard deviation over x and y (Figs. 12, 24, 25, 26).

    Parameters
    ----------
    variant : str
        The model's name.
    target : {"p_norm", "exposure_ms"}
        Predicted column.
    sensor : {'structured-light', 'stereo'}
        Sensor that measures it.
    x_mm : (nx,) ndarray
        Grid in the TCP frame, mm: the training data's range.
    y_mm : (ny,) ndarray
        The same along y.
    z_mm : (3,) ndarray
        Depths, mm.
    i_avg : (3,) ndarray
        Grey levels.
    mean, std : (3, 3, ny, nx) ndarray
        Prediction and standard deviation of a new observation, in the target's unit; first by
        grey level, then by depth.
    trained_mm : tuple of (k, 2) ndarray
        For each depth x and y of the training poses near it.
    """

    variant: str
    target: str
    sensor: SensorKind
    x_mm: NDArray[np.float64]
    y_mm: NDArray[np.float64]
    z_mm: NDArray[np.float64]
    i_avg: NDArray[np.float64]
    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    trained_mm: tuple[NDArray[np.float64], ...]


def prediction_surfaces(
    variant: str, model: GaussianProcessModel, sensor: SensorKind
) -> PredictionSurfaces:
    """Predict over the x-y plane; the sensor squarely faces the feature (w = p = 0).

    Parameters
    ----------
    variant : str
        The model's name, kept.
    sensor : {'structured-light', 'stereo'}
        Sensor that measured the training data.
    model : GaussianProcessModel
        Reads i_avg and at least x, y, z.

    Raises
    ------
    InputError
        If the model does not read the position.
    """
    names = model.inputs
    missing = [name for name in ("i_avg", "x_mm", "y_mm", "z_mm") if name not in names]
    if missing:
        msg = (
            f"surfaces over x and y need a model that reads {', '.join(missing)}; "
            f"{model.name} reads {', '.join(names)}"
        )
        raise InputError(msg)
    ranges = model.training_range
    x, y = (np.linspace(*ranges[name], _GRID, dtype=np.float64) for name in ("x_mm", "y_mm"))
    z, grey = np.array(DEPTHS_MM), np.array(GREY_LEVELS)
    i_grid, z_grid, y_grid, x_grid = np.meshgrid(grey, z, y, x, indexing="ij")
    grids = {"i_avg": i_grid, "z_mm": z_grid, "y_mm": y_grid, "x_mm": x_grid}
    square = np.zeros_like(i_grid)  # the w and p of a squarely facing sensor
    columns: dict[str, Any] = {name: grids.get(name, square).ravel() for name in names}
    prediction = model.predict(**columns)
    return PredictionSurfaces(
        variant=variant,
        target=model.target,
        sensor=sensor,
        x_mm=x,
        y_mm=y,
        z_mm=z,
        i_avg=grey,
        mean=prediction.mean.reshape(i_grid.shape),
        std=prediction.std.reshape(i_grid.shape),
        trained_mm=tuple(_near(model, depth) for depth in DEPTHS_MM),
    )


def _near(model: GaussianProcessModel, depth_mm: float) -> NDArray[np.float64]:
    x, y, z = (model.training_data[name] for name in ("x_mm", "y_mm", "z_mm"))
    near = np.abs(z - depth_mm) <= _NEAR_MM
    places = np.stack([x[near], y[near]], axis=1).reshape(-1, 2)
    return np.unique(np.round(places, 1), axis=0)
