"""The whole way on recorded stripe images: decoding, observing, learning.

Run with ``make bench NAME=real``. The recordings lie in the folder that the environment variable
EXPOSIGHT_REAL_DATA names, else in ``../shared/data/real``; examples/05_skull.py says what they are.
"""

from __future__ import annotations

import os
import runpy
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from benchmarks.agreement import compare_along_rays
from benchmarks.measuring import Figure, at_least, at_most, best_of, publish, say
from benchmarks.plate import (
    TrimeshSearch,
    flat_plate,
    holes_side_by_side,
    many_holes,
    plate_capture,
)
from exposight.cell import MemoryCampaign, sensor_preset
from exposight.geometry import read_projector_camera
from exposight.imaging import (
    decode,
    read_recording,
    sequence_named_or_read,
    triangulate,
)
from exposight.observing import (
    observe_campaign,
    observe_capture,
    point_search,
    view_features,
)
from exposight.report import CampaignReport
from exposight.workers import usual_workers

_EXAMPLE = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "05_skull.py"))
PLATE_POSES_WP_DEG = ((0.0, 0.0), (30.0, 0.0), (0.0, -30.0), (20.0, 15.0), (-10.0, 25.0))
_DEPTH_LIMITS_MM = (300.0, 2000.0)


def decoding(skull: Path) -> list[Figure]:
    """Decode both skull sequences and hold them against the authors' cloud."""
    say("decoding the skull")
    rig = read_projector_camera(skull / "calibration.xml")
    reference = loadmat(skull / "skull_gray" / "pointCloud.mat")["xyz"]
    figures = []
    for name, preset, median_limit in (("gray", "skull_gray", 0.40), ("phase", "skull_2x3", 0.38)):
        stack = read_recording(skull / preset, sequence_named_or_read(preset))
        cloud = _EXAMPLE["cloud_of"](stack, preset, rig)
        agreement = compare_along_rays(cloud, reference, rig.camera)
        by_index = np.linalg.norm(cloud.points - reference, axis=2)
        by_index = by_index[np.isfinite(by_index)]
        figures += [
            at_most(f"{name}_median_mm", agreement.median_mm, median_limit, "mm"),
            at_most(f"{name}_p90_mm", agreement.p90_mm, 1.0, "mm"),
            at_least("gray_common_points", agreement.common_points, 85000)
            if name == "gray"
            else Figure(name="phase_common_points", value=agreement.common_points),
            # The authors' cloud is organised by the undistorted image, so equal pixels are not
            # equal rays; the comparison is printed all the same.
            Figure(
                name=f"{name}_same_pixel_median_mm", value=float(np.median(by_index)), unit="mm"
            ),
            Figure(
                name=f"{name}_same_pixel_p90_mm",
                value=float(np.percentile(by_index, 90)),
                unit="mm",
            ),
        ]
    return [*figures, *_decoding_time(skull)]


def _decoding_time(skull: Path) -> list[Figure]:
    sequence = sequence_named_or_read("skull_2x3")
    rig = read_projector_camera(skull / "calibration.xml")

    def from_files_to_cloud() -> None:
        decoded = decode(read_recording(skull / "skull_2x3", sequence), sequence)
        triangulate(
            decoded,
            camera=rig.camera,
            projector=rig.projector,
            projector_from_camera=rig.projector_from_camera,
            depth_limits_mm=_DEPTH_LIMITS_MM,
        )

    timing = best_of(5, from_files_to_cloud)
    return [
        at_most("decode_phase_s", timing.wall_s, 1.0, "s"),
        Figure(name="decode_phase_cpu_s", value=timing.cpu_s, unit="s"),
    ]


def board(folder: Path) -> list[Figure]:
    """Decode the flat checkerboard: the camera-to-projector map on it is a homography."""
    say("decoding the board")
    sequence = sequence_named_or_read("board")
    stack = read_recording(folder / "capture_0", sequence)
    decoded = decode(stack, sequence)
    white = np.asarray(stack.frames[40])
    on_board = checkerboard_mask(white)
    if decoded.column is None or decoded.row is None:
        msg = "the board's sequence codes columns and rows"
        raise RuntimeError(msg)
    v, u = np.nonzero(on_board & decoded.valid)
    pixels = np.column_stack([u, v]).astype(np.float64)
    projected = np.column_stack([decoded.column[v, u], decoded.row[v, u]])
    homography, _ = cv2.findHomography(pixels, projected, cv2.RANSAC, 3.0)
    fitted = cv2.perspectiveTransform(pixels[None], homography)[0]
    error = np.linalg.norm(fitted - projected, axis=1)
    return [
        at_most("board_median_px", float(np.median(error)), 0.45, "projector px"),
        at_least("board_inlier_share", float(np.mean(error <= 3.0)), 0.99),
        Figure(name="board_pixels", value=len(error), unit="px"),
    ]


def checkerboard_mask(white: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return the pixels of the printed 7 × 9 checkerboard, one square round its inner corners.

    The sheet hangs before a wall of another plane, so "on the board" has to be said; the printed
    pattern says it best.
    """
    size = (9, 7)
    found, corners = cv2.findChessboardCornersSB(white, size)
    if not found:
        msg = "the checkerboard was not found in the white frame"
        raise RuntimeError(msg)
    grid = np.mgrid[0 : size[0], 0 : size[1]].T.reshape(-1, 2).astype(np.float64)
    image_from_grid, _ = cv2.findHomography(grid, corners.reshape(-1, 2))
    outer = np.array([[-1, -1], [size[0], -1], [size[0], size[1]], [-1, size[1]]], dtype=float)
    polygon = cv2.perspectiveTransform(outer[None], image_from_grid)[0]
    mask = np.zeros(white.shape, dtype=np.uint8)
    cv2.fillConvexPoly(mask, np.round(polygon).astype(np.int32), 1)
    return mask.astype(bool)


def perfect_plate() -> list[Figure]:
    """Measure p_norm on a flat plate with a perfect organised cloud: it must be 1."""
    say("observing perfect plates")
    worst = 0.0
    for preset in ("comet-pro-ae", "rc-visard-65"):
        sensor = sensor_preset(preset)
        for w_deg, p_deg in PLATE_POSES_WP_DEG:
            part = holes_side_by_side()
            capture = plate_capture(sensor, flat_plate(sensor, w_deg, p_deg))
            campaign = MemoryCampaign(name="plate", sensor=sensor, part=part, captures=[capture])
            measured = observe_campaign(campaign).measured()
            if len(measured) != len(part.features):
                msg = f"{preset} at w {w_deg}°, p {p_deg}°: a hole was not visible"
                raise RuntimeError(msg)
            worst = max(worst, float(np.abs(measured.array(["p_norm"]) - 1.0).max()))
    return [at_most("ring_worst_error", worst, 0.02)]


def observing_speed() -> list[Figure]:
    """Observe 500 holes in one 4-megapixel capture; then count with trimesh instead."""
    say("observing 500 holes")
    sensor = sensor_preset("comet-pro-ae")
    capture = plate_capture(sensor, flat_plate(sensor, 0.0, 0.0))
    part = many_holes(500)
    campaign = MemoryCampaign(name="plate", sensor=sensor, part=part, captures=[capture])
    ours = best_of(5, lambda: observe_campaign(campaign))
    cloud = capture.require_cloud()
    loose = replace(capture, cloud=replace(cloud, points=cloud.points.reshape(-1, 3)))
    unorganised = MemoryCampaign(name="plate", sensor=sensor, part=part, captures=[loose])
    any_order = best_of(2, lambda: observe_campaign(unorganised))
    say("the same with trimesh's containment test")
    views = view_features(part, sensor, capture.camera_from_part)
    peer = TrimeshSearch(cloud.points)
    counted = [r.n_points or 0 for r in observe_capture(capture, views, peer)]
    exact = point_search(cloud, sensor.camera).count(views)
    difference = float(np.abs(np.array(counted) / exact - 1.0).max())

    def with_trimesh() -> None:
        observe_capture(capture, view_features(part, sensor, capture.camera_from_part), peer)

    theirs = best_of(1, with_trimesh)
    return [
        at_most("observe_500_features_s", ours.wall_s, 0.5, "s"),
        Figure(name="observe_500_features_cpu_s", value=ours.cpu_s, unit="s"),
        Figure(name="observe_500_unorganised_s", value=any_order.wall_s, unit="s"),
        Figure(name="trimesh_s", value=theirs.wall_s, unit="s"),
        Figure(name="trimesh_cpu_s", value=theirs.cpu_s, unit="s"),
        Figure(name="trimesh_ratio", value=theirs.wall_s / ours.wall_s, unit="×"),
        Figure(name="trimesh_largest_difference_percent", value=100 * difference, unit="%"),
    ]


def learning(skull: Path) -> list[Figure]:
    """Run the example and score the models on features they never saw."""
    say("running the example (a minute or two)")
    with tempfile.TemporaryDirectory() as folder:
        report = _EXAMPLE["skull_report"](skull, Path(folder), workers=usual_workers())
    scores = {own.name: own.evaluation.score for own in report.results}
    figures = [
        Figure(
            name="skull_q1_rmse_percent",
            value=100 * scores["q_k1"].rmse,
            unit="% of full scale",
        ),
        Figure(name="skull_e_rmse_ms", value=scores["e_k6"].rmse, unit="ms"),
        Figure(name="skull_features", value=len(report.summary.features)),
        Figure(name="skull_ring_overlap_share", value=_ring_overlap(report)),
    ]
    for name, score in scores.items():
        scale, unit = (100.0, "percent") if name.startswith("q") else (1.0, "ms")
        figures.append(
            Figure(name=f"skull_{name}_rmse_{unit}", value=scale * score.rmse, unit=unit)
        )
        figures.append(
            Figure(name=f"skull_{name}_r2_percent", value=score.r2_percent, unit="percent")
        )
    return figures


def _ring_overlap(report: CampaignReport) -> float:
    """Return the share of the unseen features' ring pixels that trained all the same."""
    trained = np.zeros(report.view.captures[0].image.shape, dtype=bool)
    for view in report.view.views:
        if view.feature.name not in report.unseen:
            trained[view.rows, view.columns] = True
    unseen = [view for view in report.view.views if view.feature.name in report.unseen]
    shared = sum(int(trained[view.rows, view.columns].sum()) for view in unseen)
    return shared / sum(view.n_pixels for view in unseen)


def main() -> None:
    """Run everything."""
    skull = Path(os.environ.get("EXPOSIGHT_REAL_DATA", "../shared/data/real")) / "skull"
    figures = [
        *decoding(skull),
        *board(skull.parent / "board"),
        *perfect_plate(),
        *observing_speed(),
        *learning(skull),
    ]
    publish("the whole way on recorded stripe images", figures)


if __name__ == "__main__":
    main()
