"""A real recording, from stripe images to the page of a campaign.

SLStudio's authors scanned a skull with one camera and one projector (J. Wilm, O. V. Olesen,
R. Larsen, "SLStudio: open-source framework for real-time structured light", IPTA 2014; the example
data of that software). Here its stripes are decoded, ring features are placed on its surface, an
exposure sweep is emulated from the one exposure that was recorded, and models learn from half of
the features what they then predict for the others:

    python examples/05_skull.py FOLDER OUTPUT

FOLDER holds calibration.xml and the frames as PNG in skull_gray and skull_2x3; OUTPUT gets the
campaign, observations, models and report.html.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight.cell import (
    PAPER_TOLERANCE,
    ActiveSensor,
    CampaignFolder,
    CampaignWriter,
    Capture,
    Cloud,
    ExposureRange,
    Feature,
    Part,
    Projector,
)
from exposight.geometry import (
    ProjectorCamera,
    RigidTransform,
    read_projector_camera,
    rotation_facing,
)
from exposight.imaging import (
    DecodedMap,
    FrameStack,
    decode,
    re_expose,
    read_recording,
    sequence_named_or_read,
    stack_images,
    triangulate,
)
from exposight.models import MODEL_SUFFIX, MODELS, ModelSpecification, save_model, train_all
from exposight.observing import Visibility, observe_campaign, point_search, view_features
from exposight.report import CampaignReport, campaign_report
from exposight.statistics import split_by_group

NOMINAL_MS = 10.0  # what the recorded frames count as: their exposure time was not handed down
EXPOSURES_MS = tuple(round(NOMINAL_MS * 10.0 ** (step / 8), 3) for step in range(-6, 7))
DEPTH_LIMITS_MM = (300.0, 2000.0)  # drops stray points of wrong unwrapping
NOTES = (
    "Stripe images of a skull, decoded to point clouds. The recording counts as a nominal 10 ms.",
    "All features lie in one static view and a random half of them trained, so errors are "
    "optimistic: rings of unseen features share pixels with rings that trained.",
    "Recording: J. Wilm, O. V. Olesen, R. Larsen, “SLStudio: Open-source framework for real-time "
    "structured light”, IPTA 2014. It belongs to its authors; pictures here are derived from it.",
)


def cloud_of(stack: FrameStack, name: str, rig: ProjectorCamera) -> Cloud:
    """Decode frames and triangulate them."""
    return points_of(decode(stack, sequence_named_or_read(name)), rig)


def points_of(decoded: DecodedMap, rig: ProjectorCamera) -> Cloud:
    """Triangulate what was decoded."""
    return triangulate(
        decoded,
        camera=rig.camera,
        projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
        depth_limits_mm=DEPTH_LIMITS_MM,
    )


def sensor_of(rig: ProjectorCamera, cloud: Cloud) -> ActiveSensor:
    """Describe the rig as a sensor, its TCP at the object's median depth, rounded to 10 mm."""
    tcp_mm = float(round(float(np.median(cloud.require_points()[:, 2])), -1))
    return ActiveSensor(
        name="SLStudio rig of the skull recording",
        cameras=(rig.camera,),
        first_from_camera=(RigidTransform(),),
        projector=Projector(
            camera=rig.projector, camera_from_projector=rig.projector_from_camera.inverse()
        ),
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, tcp_mm])),
        exposure=ExposureRange(min_ms=0.1, max_ms=1000.0, increment_ms=0.001),
        working_distance_mm=DEPTH_LIMITS_MM,
    )


def place_features(
    cloud: Cloud, sensor: ActiveSensor, count: int, rng: np.random.Generator
) -> tuple[Feature, ...]:
    """Place ring features where the surface is smooth, faces the camera and is there all round."""
    features, search = list[Feature](), point_search(cloud, sensor.camera)
    for row, column in rng.permutation(np.argwhere(cloud.valid)):
        point = cloud.points[row, column]
        centres = [own.part_from_feature.translation_mm for own in features]
        if any(np.linalg.norm(point - centre) < 3.0 for centre in centres):
            continue  # would be a near copy
        name, radius_mm = f"s{len(features) + 1:03d}", round(float(rng.uniform(2.0, 6.0)), 2)
        feature = Feature(
            name=name, kind="hole", part_from_feature=RigidTransform(), radius_mm=radius_mm
        )
        reach_mm = feature.measured_region(PAPER_TOLERANCE).outer_mm
        pose = fitted_pose(cloud, sensor, row, column, reach_mm)
        if pose is None:
            continue
        feature = replace(feature, part_from_feature=pose)
        part = Part(name="patch", features=(feature,))
        (view,) = view_features(part, sensor, RigidTransform())
        if view.visibility is not Visibility.VISIBLE or view.pose["incidence_deg"] > 50.0:
            continue
        if 0.9 <= search.count([view])[0] / view.n_pixels <= 1.1:
            features.append(feature)
        if len(features) == count:
            break
    return tuple(features)


def fitted_pose(
    cloud: Cloud, sensor: ActiveSensor, row: int, column: int, reach_mm: float
) -> RigidTransform | None:
    """Fit a plane to the patch about a pixel's point; None where the surface is too uneven."""
    centre = cloud.points[row, column].astype(np.float64)
    half = int(np.ceil(reach_mm * sensor.camera.fx / centre[2]))
    rows, columns = (slice(max(own - half, 0), own + half + 1) for own in (row, column))
    offsets = cloud.points[rows, columns].reshape(-1, 3).astype(np.float64) - centre
    offsets = offsets[np.einsum("ij,ij->i", offsets, offsets) <= reach_mm**2]  # NaN fails
    if len(offsets) < 50:
        return None
    mean = offsets.mean(axis=0)
    variances, axes = np.linalg.eigh(np.cov(offsets, rowvar=False))
    if variances[0] > 1.0:  # mm²
        return None
    normal: NDArray[np.float64] = axes[:, 0] if axes[:, 0] @ centre > 0 else -axes[:, 0]
    return RigidTransform(
        rotation=rotation_facing(normal), translation_mm=centre + (mean @ normal) * normal
    )


def skull_report(
    folder: Path,
    output: Path,
    *,
    features: int = 220,
    exposures_ms: tuple[float, ...] = EXPOSURES_MS,
    models: tuple[ModelSpecification, ...] = MODELS,
    restarts: int = 3,
    workers: int = 1,
) -> CampaignReport:
    """Measure, learn and report; what is in the output folder already is not made again."""
    rig = read_projector_camera(folder / "calibration.xml")
    sequence = sequence_named_or_read("skull_2x3")
    recorded = read_recording(folder / "skull_2x3", sequence, exposure_ms=NOMINAL_MS)
    cloud = cloud_of(recorded, "skull_2x3", rig)
    sensor = sensor_of(rig, cloud)
    placed = place_features(cloud, sensor, features, np.random.default_rng(1))
    part = Part(name="skull", features=placed)
    output.mkdir(parents=True, exist_ok=True)
    place = output / "campaign"
    with CampaignWriter.open_or_create(place, name="skull", sensor=sensor, part=part) as writer:
        for exposure_ms in exposures_ms:
            if writer.has("skull", exposure_ms):
                continue
            factor = exposure_ms / NOMINAL_MS
            stack = recorded if factor == 1 else re_expose(recorded, factor)
            decoded = decode(stack, sequence)
            writer.add(
                Capture(
                    view="skull",
                    exposure_ms=exposure_ms,
                    image=stack.frames[0],  # its finest fringes
                    stack=stack_images(stack, sequence, decoded),
                    cloud=points_of(decoded, rig),
                    camera_from_part=RigidTransform(),
                    emulated=stack.emulated,
                )
            )
    campaign = CampaignFolder(place)
    table = observe_campaign(campaign)
    table.write(output / "observations.csv")
    split = split_by_group(table.names("feature"), 0.5, np.random.default_rng(1))
    trains = np.isin(np.arange(len(table)), split.train)
    known = table.where(trains)
    trained = train_all(models, known, seed=1, sensor=sensor, restarts=restarts, workers=workers)
    for model in trained:
        save_model(output / f"{model.name}{MODEL_SUFFIX}", model)
    unseen = set(table.names("feature")[~trains])
    return campaign_report(campaign, trained, unseen=unseen, title="A recorded skull", notes=NOTES)


if __name__ == "__main__":
    skull, output = map(Path, sys.argv[1:])
    report = skull_report(skull, output)
    for result in report.results:
        score = result.evaluation.score
        print(
            f"{result.name}: R² {score.r2_percent:.1f} %, RMSE {score.rmse:.3g} on unseen features"
        )
    print(report.write(output))
