"""A measuring plan for a part that nobody has captured yet: views found, exposure times spread."""

from dataclasses import dataclass
from typing import Annotated

from cyclopts import Group, Parameter
from cyclopts.types import PositiveInt

from exposight.cell import ActiveSensor, Part
from exposight.geometry.meshes.triangle_meshes import Mesh
from exposight.planning.viewing.viewpoints import candidate_views
from exposight.plans import MeasuringPlan, PoseList
from exposight.plans.positions import logarithmic_exposures
from exposight.twin.part import SCENE_FILE
from exposight.workers import Progress, ignore_progress


@Parameter("*", group=Group("First plan, with --sensor", sort_key=3))
@dataclass(frozen=True, kw_only=True)
class FirstPlanOptions:
    """What is captured to learn how the part looks to the sensor.

    Parameters
    ----------
    views
        Views of the plan at most: found so that each feature is seen in several lights.
    exposures
        Exposure times of each view, evenly spread over the logarithm of the sensor's range.
    exposure_range
        Shortest and longest of them, ms; the sensor's by default.
    """

    views: PositiveInt = 16
    exposures: Annotated[PositiveInt, Parameter("--exposures")] = 8
    exposure_range: Annotated[tuple[float, float] | None, Parameter(metavar="MIN MAX")] = None


def first_plan(
    part: Part,
    sensor: ActiveSensor,
    mesh: Mesh,
    options: FirstPlanOptions,
    progress: Progress = ignore_progress,
) -> tuple[MeasuringPlan, list[str]]:
    """Return a measuring plan of views that are found by themselves, and remarks.

    Parameters
    ----------
    part : Part
        Its features are to be seen.
    sensor : ActiveSensor
        Which looks.
    mesh : Mesh
        What hides and shadows.
    options : FirstPlanOptions
    progress : Progress

    Raises
    ------
    InputError
        If no view sees a feature, or the sensor cannot take the exposure times.
    """
    found = candidate_views(part, sensor, mesh=mesh, count=options.views, progress=progress)
    low, high = options.exposure_range or (sensor.exposure.min_ms, sensor.exposure.max_ms)
    views = PoseList(
        name="auto",
        notation="matrix",
        frame="camera_from_part",
        rows=tuple(
            tuple(each.camera_from_part.to_matrix().ravel().tolist()) for each in found.views
        ),
        names=tuple(each.name for each in found.views),
        exposures_ms=logarithmic_exposures(low, high, options.exposures, sensor),
    )
    plan = MeasuringPlan(
        name=part.name,
        sensor=sensor,
        features=tuple(f.name for f in part.features if f.name not in found.unreachable),
        poses=(views,),
        blind_views="skip",
        simulated={"scene": SCENE_FILE},
    )
    notes = [f"{name} is in no view: {why}" for name, why in found.unreachable.items()]
    return plan, [*found.notes, *notes]
