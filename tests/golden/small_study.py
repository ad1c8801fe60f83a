"""A small study from end to end: measured in the simulated cell, decoded, learnt, judged.

Its numbers are kept in `golden.json`. They change when physics, decoding or learning changes, and
never because code is moved: run this file to write them again, and say in the commit why they
differ.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import polars as pl

from exposight.measuring import measure, measure_observations
from exposight.models import Training, evaluate, model_named
from exposight.observing import ObservationTable
from exposight.plans import plan_preset
from exposight.statistics import maximal_information_matrix
from exposight.twin import SimulatedCell

GOLDEN = Path(__file__).with_name("golden.json")
MODELS = ("q_k1", "q_k4", "e_k1", "e_k4", "e_k6_star", "e_k6", "e_k6_lin")
COLUMNS = (
    "exposure_ms",
    "p_norm",
    "i_avg",
    "x_mm",
    "y_mm",
    "z_mm",
    "w_deg",
    "p_deg",
    "i_std",
    "i_p95",
    "incidence_deg",
)


def observations() -> dict[str, ObservationTable]:
    """Measure three small plans: stripes inside, stripes outside under other finishes, dots."""
    small = plan_preset("small")
    stripes = replace(
        small,
        planes=tuple(
            replace(
                plane,
                x_mm=plane.x_mm[:1],
                y_mm=plane.y_mm[:1],
                exposures_ms=plane.exposures_ms[1::2],
            )
            for plane in small.planes
        ),
    )
    outside = plan_preset("x-out")
    (box,) = outside.random
    outside = replace(outside, random=(replace(box, count=2, exposures_ms=(15.0, 65.0)),))
    stereo = plan_preset("stereo-x")
    plane = stereo.planes[2]
    dots = replace(
        stereo, planes=(replace(plane, x_mm=(-60.0,), y_mm=(0.0,), exposures_ms=(0.5, 3.0)),)
    )
    return {
        "stripes": measure_observations(stripes, SimulatedCell.for_plan(stripes, rings_only=True)),
        "outside": measure_observations(outside, SimulatedCell.for_plan(outside, rings_only=True)),
        "dots": measure_observations(dots, SimulatedCell.for_plan(dots)),
    }


def decoded() -> dict[str, float]:
    """Simulate one whole capture with its raw frames and decode them again from files."""
    plan = plan_preset("small")
    plane = replace(plan.planes[1], x_mm=(-100.0,), y_mm=(80.0,), exposures_ms=(33.0,))
    plan = replace(plan, planes=(plane,))
    with tempfile.TemporaryDirectory() as folder:
        campaign = measure(plan, SimulatedCell.for_plan(plan, raw_frames=True), Path(folder) / "c")
        (capture,) = campaign.captures()
        attachments = dict(capture.attachments)
    points = capture.require_cloud().valid_points.astype(np.float64)
    frames = np.stack(
        [_image(attachments[name]) for name in sorted(attachments) if name.startswith("frame-")]
    )
    return {
        "points": len(points),
        **{
            f"mean_{axis}_mm": float(mean)
            for axis, mean in zip("xyz", points.mean(axis=0), strict=True)
        },
        **{
            f"std_{axis}_mm": float(std)
            for axis, std in zip("xyz", points.std(axis=0), strict=True)
        },
        "image_sum": int(capture.image.astype(np.int64).sum()),
        "frames_sum": int(frames.astype(np.int64).sum()),
        "frames": len(frames),
    }


def _image(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_UNCHANGED)


def small_study(recorded: dict[str, Any] | None = None) -> dict[str, dict[str, object]]:
    """Return every number of the study by name.

    Parameters
    ----------
    recorded : dict, optional
        The numbers on record. Models then learn the qualities on record, so that what they learn
        does not depend on how many pixels at the decoder's limits this processor decodes.
    """
    tables = observations()
    result: dict[str, dict[str, object]] = {"decoded": decoded()}
    for name, table in tables.items():
        values = table.array(COLUMNS)
        result[f"observations {name}"] = {
            "feature": table.names("feature").tolist(),
            "view": table.names("view").tolist(),
            "visibility": table.frame["visibility"].to_list(),
            "n_points": table.frame["n_points"].to_list(),
            "n_pixels": table.frame["n_pixels"].to_list(),
            **{
                column: [None if np.isnan(v) else float(v) for v in values[:, i]]
                for i, column in enumerate(COLUMNS)
            },
        }
    table = tables["stripes"]
    if recorded is not None:
        on_record = pl.Series("p_norm", recorded["observations stripes"]["p_norm"])
        table = ObservationTable(frame=table.frame.with_columns(on_record))
    table = table.measured()
    unseen = np.array([name.endswith("_test") for name in table.names("feature")])
    known, test = table.where(~unseen), table.where(unseen)
    for name in MODELS:
        specification = model_named(name)
        model = Training(specification=specification, table=known, seed=1, restarts=1).run()
        judged = evaluate(model, test)
        result[f"model {name}"] = {
            "log_marginal_likelihood": model.summary.log_marginal_likelihood,
            "rmse": judged.score.rmse,
            "r2": judged.score.r2_percent,
            "mean": judged.prediction.mean.tolist(),
            "std": judged.prediction.std.tolist(),
        }
    matrix = maximal_information_matrix(table.array(COLUMNS[:8]))
    result["dependence"] = {"coefficients": matrix.ravel().tolist()}
    return result


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(small_study(), indent=1) + "\n", encoding="utf-8")
