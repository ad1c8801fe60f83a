"""What merging exposures gains, with clouds merged in the simulated cell, beside its promise."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import polars as pl

from benchmarks.measuring import Figure, at_least, publish, say
from benchmarks.plan_campaigns import SWEEPS, sweep_of, sweep_plan, training_table
from exposight.cell import Capture, Cloud
from exposight.geometry import PinholeCamera
from exposight.imaging import merge_captures
from exposight.models import WindowModel, train_window
from exposight.observing import ObservationTable
from exposight.observing.observe import Observer
from exposight.planning.merged_quality import TARGETS, MergeGain, merged_chance, merged_p_norm
from exposight.plans import PlannedView
from exposight.twin import SimulatedCell

_VIEWS = 8
_LOW, _HIGH = 0.2, 0.75
"""p_norm of a capture that is too dark, or clips, and has some of a ring nevertheless."""


def _times_ms(view: pl.DataFrame) -> tuple[float, float, float] | None:
    """Return two exposure times that have most features in part each, and one between for all."""
    wide = view.pivot("exposure_ms", index="feature", values="p_norm").drop("feature")
    times, p = np.array(list(map(float, wide.columns))), wide.to_numpy()
    order = np.argsort(times)
    times, p = times[order], p[:, order]
    partly = (p >= _LOW) & (p <= _HIGH)
    best = times[p.argmax(axis=1)]
    dark, clipped = partly & (times < best[:, None]), partly & (times > best[:, None])
    pairs = [
        (int((dark[:, i] & clipped[:, j]).sum()), i, j)
        for i, j in combinations(range(len(times)), 2)
    ]
    count, i, j = max(pairs)
    between = times[(p >= _HIGH).sum(axis=0).argmax()]
    return (times[i], float(between), times[j]) if count and times[i] < between < times[j] else None


def _organised(capture: Capture, camera: PinholeCamera) -> Capture:
    """Return a capture whose points, which lie where their pixels look, have the image's rows."""
    points = capture.require_cloud().valid_points
    column, row = np.rint(camera.project(points)).astype(np.int64).T
    cloud = np.full((*capture.image.shape, 3), np.nan, dtype=np.float32)
    cloud[row, column] = points
    assert np.count_nonzero(~np.isnan(cloud[..., 0])) == len(points)
    return replace(capture, cloud=Cloud(points=cloud))


def _promised(model: WindowModel, rows: ObservationTable, times: tuple[float, ...]) -> pl.DataFrame:
    rings = rows.frame.unique(["feature", "view"], maintain_order=True)
    forecast = model.forecast(rings, times)
    chances = {f"chance_{t}": merged_chance(forecast, times, t) for t in TARGETS}
    expected = merged_p_norm(forecast, times)
    return rings.select("feature", "view").with_columns(
        promised=pl.Series(expected),
        **{name: pl.Series(values) for name, values in chances.items()},
    )


def _mean(frame: pl.DataFrame, name: str) -> float:
    return float(frame[name].to_numpy().mean())


def figures() -> list[Figure]:
    """Merge a dark and a clipped capture, and these with a good one, and compare."""
    bare, seed = SWEEPS[0], 1
    truth = sweep_of(bare, seed).measured().frame
    plan = sweep_plan(bare.views, seed)
    cell = SimulatedCell.for_plan(plan, rings_only=True)
    part = plan.observed_part(cell.part)
    model = train_window(training_table(seed))
    observer = Observer(part, cell.sensor)
    pairs: list[pl.DataFrame] = []
    triples: list[pl.DataFrame] = []
    views: list[PlannedView] = list(plan.views(cell.part))
    for view in views:
        times = _times_ms(truth.filter(pl.col("view") == view.name))
        if times is None:
            continue
        captures = [
            _organised(cell.capture(t, view.camera_from_part, view=view.name), cell.sensor.camera)
            for t in times
        ]
        rows = [
            ObservationTable.from_observations(observer.observe(c)).measured() for c in captures
        ]
        for chosen, into in (((0, 2), pairs), ((0, 1, 2), triples)):
            merged = merge_captures([captures[i] for i in chosen])
            observed = ObservationTable.from_observations(observer.observe(merged)).measured()
            taken = tuple(times[i] for i in chosen)
            singles = [rows[i] for i in chosen]
            promised = _promised(model, rows[0], taken)
            gain = MergeGain.of(ObservationTable.concat(singles), observed, promised).frame
            each = (
                singles[0]
                .frame.select("feature", "view", first="p_norm")
                .join(
                    singles[-1].frame.select("feature", "view", last="p_norm"),
                    on=["feature", "view"],
                )
            )
            into.append(
                gain.join(each, on=["feature", "view"]).join(
                    promised.drop("promised"), on=["feature", "view"]
                )
            )
        say(f"{view.name}: {', '.join(f'{t:g}' for t in times)} ms")
        if len(pairs) == _VIEWS:
            break
    both = pl.concat(pairs).filter(
        pl.col("first").is_between(_LOW, _HIGH) & pl.col("last").is_between(_LOW, _HIGH)
    )
    every = pl.concat(triples)
    for name, frame in (("a dark and a clipped capture", both), ("with a good one between", every)):
        say(
            f"{name}, {frame.height} features: best single {_mean(frame, 'single'):.3f}, merged "
            f"{_mean(frame, 'merged'):.3f}, promised {_mean(frame, 'promised'):.3f}"
        )
        for target in TARGETS:
            row = MergeGain(frame=frame).reached(target)
            say(
                f"  p_norm {target:g}: singly {row['single']}, merged {row['merged']}, promised "
                f"{frame.height * _mean(frame, f'chance_{target}'):.1f} of {frame.height}"
            )
    promises = [_mean(frame, "promised") - _mean(frame, "single") for frame in (both, every)]
    return [
        at_least("hdr_gain_dark_and_clipped", _mean(both, "gain"), 0.25),
        Figure(name="hdr_gain_dark_and_clipped_promised", value=promises[0]),
        Figure(name="hdr_gain_best", value=_mean(every, "gain")),
        Figure(name="hdr_gain_best_promised", value=promises[1]),
        Figure(name="hdr_features", value=both.height),
    ]


if __name__ == "__main__":
    publish("Merging exposures", figures())
