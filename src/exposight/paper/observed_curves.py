"""Observations as curves: one feature in one view over all exposure times."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from exposight.errors import ObservationError
from exposight.observing import ObservationTable
from exposight.paper.study_settings import SensorKind

_COLUMNS = ("exposure_ms", "i_avg", "p_norm", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "radius_mm")
_ROW_WIDTH_MM = 10.0
"""Positions of one row of a grid differ by alignment errors, "up to 5 mm" (Sect. 3.2.2), each."""
_ENOUGH_PLACES = 3
"""Places along x that show a trend."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservedCurve:
    """One feature in one view at k exposure times, the shortest first.

    Parameters
    ----------
    feature, view : str
        Names.
    exposure_ms : (k,) ndarray
        Exposure times in ms.
    i_avg : (k,) ndarray
        Mean grey values, 0–255.
    p_norm : (k,) ndarray
        Qualities.
    x_mm, y_mm, z_mm : float
        Position in the TCP frame, mean over the captures.
    w_deg, p_deg : float
        Orientation in the TCP frame.
    radius_mm : float
        The feature's radius.
    """

    feature: str
    view: str
    exposure_ms: NDArray[np.float64]
    i_avg: NDArray[np.float64]
    p_norm: NDArray[np.float64]
    x_mm: float
    y_mm: float
    z_mm: float
    w_deg: float
    p_deg: float
    radius_mm: float

    @property
    def slope_ms(self) -> float:
        """Milliseconds for one grey level: least squares of t_exp = slope · i_avg."""
        return float(self.exposure_ms @ self.i_avg / (self.i_avg @ self.i_avg))


@dataclass(frozen=True, kw_only=True, eq=False)
class BrightnessCurves:
    """p_norm over i_avg (Figs. 10 and 16).

    Parameters
    ----------
    sensor : {'structured-light', 'stereo'}
        Sensor that measures it.
    dataset : str
        Dataset that the rows come from.
    curves : tuple of ObservedCurve
        By feature, then view.
    """

    sensor: SensorKind
    dataset: str
    curves: tuple[ObservedCurve, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExposureRow:
    """t_exp over i_avg of one feature along the sensor's x axis (Figs. 13 and 17).

    Parameters
    ----------
    sensor : {'structured-light', 'stereo'}
        Sensor that measures it.
    dataset : str
        Dataset that the rows come from.
    curves : tuple of ObservedCurve
        Views with y and z near to 0 (`nearest_row`), by growing x.
    """

    sensor: SensorKind
    dataset: str
    curves: tuple[ObservedCurve, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class FeaturePositions:
    """Positions of one feature relative to the sensor, a point for each view (Fig. 21).

    Parameters
    ----------
    feature : str
        Its name.
    positions_mm : (n, 3) ndarray
        x, y, z in the TCP frame, mm.
    """

    feature: str
    positions_mm: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingPositions:
    """Positions of all training features (Fig. 21).

    Parameters
    ----------
    dataset : str
        Dataset that the rows come from.
    features : tuple of FeaturePositions
        By name.
    """

    dataset: str
    features: tuple[FeaturePositions, ...]


def observed_curves(table: ObservationTable) -> tuple[ObservedCurve, ...]:
    """Return a curve for each feature and view that has measured rows, by feature, then view."""
    measured = table.measured()
    features, views = measured.names("feature"), measured.names("view")
    values = measured.array(_COLUMNS)
    curves = []
    for feature, view in sorted(set(zip(features.tolist(), views.tolist(), strict=True))):
        rows = values[(features == feature) & (views == view)]
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        x, y, z, w, p, radius = rows[:, 3:].mean(axis=0).tolist()
        curves.append(
            ObservedCurve(
                feature=feature,
                view=view,
                exposure_ms=rows[:, 0],
                i_avg=rows[:, 1],
                p_norm=rows[:, 2],
                x_mm=x,
                y_mm=y,
                z_mm=z,
                w_deg=w,
                p_deg=p,
                radius_mm=radius,
            )
        )
    return tuple(curves)


def extreme_radii(curves: tuple[ObservedCurve, ...]) -> tuple[ObservedCurve, ...]:
    """Return the curves of the smallest and the largest feature (Fig. 16 shows two features)."""
    radii = {curve.feature: curve.radius_mm for curve in curves}
    if not radii:
        return ()
    chosen = {min(radii, key=radii.__getitem__), max(radii, key=radii.__getitem__)}
    return tuple(curve for curve in curves if curve.feature in chosen)


def nearest_row(curves: tuple[ObservedCurve, ...]) -> tuple[ObservedCurve, ...]:
    """Return one feature's curves along x whose y and z are near to 0, by growing x.

    The paper shows y_tcp = z_tcp = 0 (Figs. 13 and 17). A grid of an even number of positions has
    no such row; then the nearest one is shown: the first feature's nearest row of at least three
    places, or where no feature has three, of as many as there are.

    Parameters
    ----------
    curves : tuple of ObservedCurve
        Of at least two exposure times each; shorter ones are left out.

    Raises
    ------
    ObservationError
        If no curve is left.
    """
    long = [curve for curve in curves if len(curve.exposure_ms) > 1]
    if not long:
        msg = f"a trend needs a feature at two exposure times of one view, got {len(curves)} curves"
        raise ObservationError(msg)
    rows = [(curve, _row_of(curve, long)) for curve in long]
    _, chosen = min(
        rows,
        key=lambda item: (
            -min(len(item[1]), _ENOUGH_PLACES),
            item[0].feature,
            float(np.hypot(item[0].y_mm, item[0].z_mm)),
            item[0].view,
        ),
    )
    return tuple(sorted(chosen, key=lambda curve: (curve.x_mm, curve.view)))


def _row_of(one: ObservedCurve, curves: list[ObservedCurve]) -> list[ObservedCurve]:
    """Return the curves of the same feature beside one along x."""
    return [
        curve
        for curve in curves
        if curve.feature == one.feature
        and abs(curve.y_mm - one.y_mm) <= _ROW_WIDTH_MM
        and abs(curve.z_mm - one.z_mm) <= _ROW_WIDTH_MM
    ]


def feature_positions(table: ObservationTable) -> tuple[FeaturePositions, ...]:
    """Return the positions of each feature, by the features' names."""
    curves = observed_curves(table)
    return tuple(
        FeaturePositions(
            feature=feature,
            positions_mm=np.array(
                [(item.x_mm, item.y_mm, item.z_mm) for item in curves if item.feature == feature]
            ),
        )
        for feature in sorted({curve.feature for curve in curves})
    )
