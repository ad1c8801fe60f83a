"""The default exposure-time model: a ring's radiance from its pose, and what it was learnt on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import Field

from exposight import __version__
from exposight.cell import GREY_MAX
from exposight.errors import ObservationError
from exposight.files import validate
from exposight.gp import GaussianProcess, kernel_from_dict
from exposight.models.abstaining import FAR, far_away
from exposight.models.evaluation import check_exposures
from exposight.models.log_radiance import Formula, LogRadiance, check_learnt_from
from exposight.models.origin import ORIGIN_COLUMNS, Origin
from exposight.models.prediction import Prediction
from exposight.models.predictor import (
    Hyperparameter,
    Predictor,
    input_array,
    register_predictor,
)
from exposight.models.radiance_search import MeanKind
from exposight.models.ring_data import (
    CLIPPED_COLUMNS,
    FEW_CLIPPED,
    clipped_share,
    ring_data,
)
from exposight.models.ring_light import POSE_COLUMNS, TURN_COLUMNS, Rings, check_places
from exposight.models.specification import P_NORM_MIN
from exposight.observing import ObservationTable
from exposight.tables import counted
from exposight.workers import Progress, ignore_progress

FloatArray: TypeAlias = NDArray[np.float64]

QUALITY, EXPOSURE = "quality", "exposure"
"""Names of the two default models."""

_NAMES = ("feature", "view")
_CLIPPED = "the ring clips: its brightness is that of no exposure time"

_FEW_GROUPS = 4
"""Features or views below which a band rests on hardly anything."""

_POOR = 0.15
"""Error of ln radiance for features left out that is worth a word."""

CHUNK = 100
"""Rings that are forecast at once."""


@register_predictor
@dataclass(frozen=True, kw_only=True, eq=False)
class RadianceModel(Predictor):
    """Predicts the exposure time with which a ring gets a wanted brightness, from its pose.

    Parameters
    ----------
    name, title, target, inputs, provenance, sensor
        As in `Predictor`.
    learnt : LogRadiance
        ln of rings' radiance.
    black_level : float, grey levels
        Brightness without light.
    black_level_known : bool
        Whether the observations told it; it is 0 otherwise.
    origin : Origin
        What it was learnt on.
    """

    kind: ClassVar[str] = "radiance"
    optional_inputs: ClassVar[tuple[str, ...]] = (
        *_NAMES,
        *TURN_COLUMNS,
        *ORIGIN_COLUMNS,
        "incidence_deg",
        *CLIPPED_COLUMNS,
    )

    learnt: LogRadiance
    black_level: float
    black_level_known: bool = True
    origin: Origin = field(default_factory=Origin)

    @property
    def brightness(self) -> str:
        """The column that brightness is read from, ``i_mean`` or ``i_avg``."""
        return self.inputs[0]

    def predict_frame(self, frame: pl.DataFrame) -> Prediction:
        """Predict for a frame with `inputs` and perhaps `optional_inputs`."""
        return self.predict_in_steps(frame, ignore_progress)

    def predict_in_steps(self, frame: pl.DataFrame, progress: Progress) -> Prediction:
        """As `predict_frame`; tells the rings that are done."""
        grey = input_array(self.name, frame.select(self.brightness))[:, 0]
        if not (grey > self.black_level).all():
            row = int(np.argmin(grey))
            msg = (
                f"{self.name}: without light the brightness is {self.black_level:.1f} grey levels "
                f"already; no exposure time gives {grey[row]:g} (row {row + 1})"
            )
            raise ObservationError(msg)
        rings, ring = self.rings(frame)
        mean, std, distance = self.radiance(rings, progress)
        logs = np.log(grey - self.black_level) - mean[ring]
        spread = std[ring]
        median = np.exp(logs)
        low, high = np.exp(logs - 2.0 * spread), np.exp(logs + 2.0 * spread)
        return Prediction(
            mean=median,
            std=median * np.sqrt(np.expm1(np.minimum(spread**2, 50.0))),
            inside=(distance[ring] <= FAR) & (clipped_share(frame) <= FEW_CLIPPED),
            low=low,
            high=high,
        )

    def unknown(self, data: ObservationTable | pl.DataFrame) -> tuple[str, ...]:
        """Say for each row why its prediction should not be relied on; empty where it may be."""
        frame = self._inputs(data, {})
        finish = self.origin.contradictions(frame).get("finish", "")
        rings, ring = self.rings(frame)
        reasons = [finish or far_away(each) for each in self.radiance(rings)[2].tolist()]
        clipped = clipped_share(frame) > FEW_CLIPPED
        return tuple(
            _CLIPPED if clips else reasons[place]
            for place, clips in zip(ring, clipped.tolist(), strict=True)
        )

    def radiance(
        self, rings: Rings, progress: Progress = ignore_progress
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return mean and standard deviation of ln radiance, and distance, of rings, (n,) each."""
        parts = []
        for start in range(0, len(rings), CHUNK):
            some = range(start, min(start + CHUNK, len(rings)))
            prediction = self.learnt.predict(rings.take(some))
            std = np.sqrt(np.diagonal(prediction.covariance))
            parts.append(np.stack([prediction.mean, std, prediction.distance]))
            progress("predicting", some.stop, len(rings))
        mean, std, distance = np.concatenate(parts, axis=1)
        return mean, std, distance

    def rings(self, frame: pl.DataFrame) -> tuple[Rings, NDArray[np.int64]]:
        """Return the rings that a frame's rows are of, and each row's place among them.

        Raises
        ------
        ObservationError
            If poses are missing, or the rows are of another sensor or TCP.
        """
        contradictions = self.origin.contradictions(frame)
        for name in ("sensor", "tcp"):
            if name in contradictions:
                msg = f"{self.name}: the rows are of {contradictions[name]}; train a model for it"
                raise ObservationError(msg)
        poses = np.stack([frame[name].to_numpy() for name in POSE_COLUMNS], axis=1)
        if poses.dtype != np.float64 or not np.isfinite(poses).all():
            poses = input_array(self.name, frame.select(POSE_COLUMNS))  # names what is wrong
        if (poses[:, 5] < 0.0).any():
            row = int(np.argmin(poses[:, 5]))
            msg = (
                f"{self.name}: radius_mm must be at least 0, got {poses[row, 5]:g} in row {row + 1}"
            )
            raise ObservationError(msg)
        turns = np.zeros((frame.height, len(TURN_COLUMNS)))
        for column, name in enumerate(TURN_COLUMNS):
            if name in frame.columns:
                turns[:, column] = np.nan_to_num(frame[name].cast(pl.Float64).to_numpy())
        features, views, parts = (
            frame[name].to_list() if name in frame.columns else [""] * frame.height
            for name in (*_NAMES, "part")
        )
        known = self.origin.part  # equal names on another part are other features
        place: dict[tuple[Any, ...], int] = {}
        ring = np.empty(frame.height, dtype=np.int64)
        first = []
        names = []
        rows = np.ascontiguousarray(np.hstack([poses, turns]))
        where = rows.view(f"V{rows.itemsize * rows.shape[1]}").ravel().tolist()
        keys = zip(features, views, parts, where, strict=True)
        for row, key in enumerate(keys):
            if key not in place:
                place[key] = len(place)
                first.append(row)
                feature, view, part, _ = key
                name = feature or f"?{row}"
                names.append((f"{part}/{name}" if known and part and part != known else name, view))
            ring[row] = place[key]
        rings = Rings(
            features=tuple(name for name, _ in names),
            views=tuple(view or "" for _, view in names),
            poses=poses[first],
            turns=turns[first],
        )
        incidence: FloatArray = np.full(len(rings), np.nan)
        if "incidence_deg" in frame.columns:
            recorded = frame["incidence_deg"].to_numpy()  # NaN where there is none
            incidence = np.asarray(recorded[first], dtype=np.float64)
        check_places(rings, incidence, self.sensor)
        return rings, ring

    @property
    def notes(self) -> tuple[str, ...]:
        """Say what weakens the model, and what would help."""
        notes = []
        if self.brightness == "i_avg":
            notes.append(
                "brightness is i_avg, of the captures' one image; if that is a stripe image, where "
                "stripes lie scatters it by some 15 %: keep the frame stacks, or a texture image"
            )
        if not self.black_level_known:
            notes.append(
                "the black level is not known and taken as 0: no ring was captured unclipped at "
                "several exposure times; add a few"
            )
        if self.sensor is None or self.learnt.formula.kind == "none":
            notes.append(
                "without the sensor's geometry, unseen features are predicted from equal poses "
                "alone; name the sensor"
            )
        elif self.learnt.formula.kind == "camera":
            notes.append(
                "the projector's pose is not known; light is taken to come from the camera"
            )
        for what, names, factor in zip(
            ("features", "views"),
            (self.learnt.features, self.learnt.views),
            self.learnt.widening,
            strict=True,
        ):
            if len(names) < _FEW_GROUPS:
                notes.append(
                    f"{counted(len(names), what.removesuffix('s'))} only: bands for unseen {what} "
                    f"are {factor:.1f} times as wide as they would be with many"
                )
        error = float(np.sqrt(np.mean(self.learnt.left_out("feature")[0] ** 2)))
        if len(self.learnt.features) > 1 and error > _POOR:
            notes.append(
                f"brightness of a feature left out is missed by {100 * error:.0f} %: the formula "
                "does not follow this finish, or poses are wrong; more views would help"
            )
        return tuple(notes)

    def rows(self, table: ObservationTable) -> ObservationTable:
        """Return the measured rows of sufficient quality whose brightness is not clipped.

        Raises
        ------
        ObservationError
            If no row has the brightness that the model reads.
        """
        if len(table) and table.frame[self.brightness].null_count() == len(table):
            msg = (
                f"{self.name} reads {self.brightness}, which no row of the table has: its captures "
                "were kept without frame stack or texture image; observe others, or train on i_avg"
            )
            raise ObservationError(msg)
        rows = table.measured().with_quality(P_NORM_MIN)
        bright = rows.frame[self.brightness].fill_null(0.0) > self.black_level + 1.0
        return rows.where(bright & pl.Series(clipped_share(rows.frame) <= FEW_CLIPPED))

    @property
    def n_observations(self) -> int:
        """Number of rings that were learnt from."""
        return len(self.learnt.process.y)

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features that it has learnt from."""
        return self.learnt.features

    @property
    def training_range(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest position and angle that were learnt from."""
        x = self.learnt.process.x
        places = {"x_mm": 0, "y_mm": 1, "z_mm": 2, "w_deg": 5, "p_deg": 6}
        return {
            name: (float(x[:, column].min()), float(x[:, column].max()))
            for name, column in places.items()
        }

    def remarks(self, frame: pl.DataFrame) -> tuple[str, ...]:
        """Say which rows are not of the finish that was learnt."""
        found = self.origin.contradictions(frame)
        return (f"{self.name}: {found['finish']}",) if "finish" in found else ()

    def with_observations(self, table: ObservationTable) -> RadianceModel:
        """Learn from more captures, as a cell does after each; the hyperparameters stay.

        Raises
        ------
        ObservationError
            If rows are of another sensor, TCP or finish than was learnt.
        """
        measured = table.measured()
        if len(measured) == 0:
            return self
        for contradiction in self.origin.contradictions(measured.frame).values():
            msg = f"{self.name}: the new rows are of {contradiction}; train a model for it"
            raise ObservationError(msg)
        check_exposures(measured, self.sensor)
        data = ring_data(measured, black_level=self.black_level)
        factor = self.learnt.surprise(data)
        if factor is not None:
            msg = (
                f"{self.name}: this is not the surface that was learnt: the new captures are "
                f"{factor:.3g} times as bright as expected; check the unit of exposure_ms, or "
                "learn another finish from them (train --from)"
            )
            raise ObservationError(msg)
        return replace(
            self,
            learnt=self.learnt.with_rings(data),
            provenance=replace(
                self.provenance,
                observations=f"{self.provenance.observations}; "
                f"{counted(len(measured), 'more row')}",
                observations_sha256=None,
                exposight_version=__version__,
            ),
        )

    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Return what was found, with units."""
        formula, process = self.learnt.formula, self.learnt.process
        items = [("black_level", self.black_level, "grey levels")]
        if formula.kind != "none":
            items += [
                ("ln specular/diffuse", formula.log_ratio, ""),
                ("lobe roughness", formula.roughness, ""),
            ]
        names = {0: "mm", 1: "mm", 2: "mm", 5: "°", 6: "°"}
        columns = ("x_mm", "y_mm", "z_mm", "half_1", "half_2", "w_deg", "p_deg", "feature", "view")
        rows = [
            Hyperparameter(name=name, quantity="parameter", inputs=(), value=value, unit=unit)
            for name, value, unit in items
        ]
        rows += [
            Hyperparameter(
                name=each.name,
                quantity=each.quantity.value,
                inputs=tuple(columns[dim] for dim in each.dims),
                value=each.value,
                unit=names.get(each.dims[0], "") if each.quantity.value == "length_scale" else "",
                remark="" if each.free else "fixed",
            )
            for each in process.kernel.parameters
            if each.dims[0] < len(columns)
        ]
        rows.append(
            Hyperparameter(
                name="noise_variance",
                quantity="variance",
                inputs=(),
                value=process.noise_variance,
                unit="",
            )
        )
        return tuple(rows)

    def to_document(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return formula, covariance and names, and the rings that were learnt from."""
        learnt, process = self.learnt, self.learnt.process
        formula = learnt.formula
        content = {
            "mean": formula.kind,
            "formula": formula.parameters.tolist(),
            "formula_prior": learnt.formula_prior,
            "kernel": process.kernel.to_dict(),
            "noise_variance": process.noise_variance,
            "features": list(learnt.features),
            "views": list(learnt.views),
            "widening": list(learnt.widening),
            "black_level": self.black_level,
            "black_level_known": self.black_level_known,
            "origin": vars(self.origin),
        }
        noise = process.row_noise if process.row_noise is not None else np.zeros(len(process.y))
        return content, {"inputs": process.x, "targets": process.y, "row_noise": noise}

    @classmethod
    def from_document(
        cls, common: Mapping[str, Any], content: dict[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> RadianceModel:
        """Rebuild a model; factors follow from the data and are computed again."""
        kept = validate(_Content, content, "model.json")
        x = np.asarray(arrays["inputs"], dtype=np.float64)
        check_learnt_from(x, kept.features, kept.views)
        process = GaussianProcess.condition(
            kernel_from_dict(kept.kernel),
            kept.noise_variance,
            x,
            arrays["targets"],
            row_noise=arrays["row_noise"],
        )
        learnt = LogRadiance(
            formula=Formula(kind=kept.mean).with_parameters(kept.formula),
            formula_prior=kept.formula_prior,
            process=process,
            sensor=common["sensor"],
            features=kept.features,
            views=kept.views,
            widening=kept.widening,
        )
        return cls(
            **common,
            learnt=learnt,
            black_level=kept.black_level,
            black_level_known=kept.black_level_known,
            origin=kept.origin,
        )


_Three = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
_Factor = Annotated[float, Field(gt=0.0)]


@dataclass(frozen=True, kw_only=True)
class _Content:
    mean: MeanKind
    formula: _Three
    formula_prior: tuple[_Three, _Three]
    kernel: dict[str, Any]
    noise_variance: Annotated[float, Field(gt=0.0)]
    features: tuple[str, ...]
    views: tuple[str, ...]
    widening: tuple[_Factor, _Factor]
    black_level: Annotated[float, Field(gt=-GREY_MAX, le=GREY_MAX)]  # it is extrapolated
    black_level_known: bool
    origin: Origin
