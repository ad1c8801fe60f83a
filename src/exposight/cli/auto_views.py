"""Views that a command finds by itself: ``--views auto``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import polars as pl
from cyclopts import Group, Parameter
from cyclopts.types import PositiveInt

from exposight.cell import ActiveSensor, Part
from exposight.cli.app import UsageError
from exposight.cli.candidate_views import CandidateViews
from exposight.cli.measure import plan_from
from exposight.geometry import RigidTransform
from exposight.geometry.meshes.triangle_meshes import read_mesh, unit_of
from exposight.planning.viewing.sensor_poses import ReachBox
from exposight.planning.viewing.viewpoints import CandidateViewpoints, candidate_views
from exposight.workers import Progress, ignore_progress

AUTO = "auto"
"""In place of a plan, a campaign or a table."""


@Parameter("*", group=Group("With --views auto", sort_key=4))
@dataclass(frozen=True, kw_only=True)
class AutoViewOptions:
    """What decides from where a part can be looked at.

    Parameters
    ----------
    mesh
        The part and what stands round it, .ply, .stl, .obj or .glb in the features' frame: it hides
        and shadows.
    mesh_unit
        Unit of the mesh; mm by default, of .glb m.
    reach
        Where the robot can bring the sensor: a box in the part's frame, mm, or a measuring plan
        whose poses are to be chosen from. Anywhere by default.
    reach_of
        What of the sensor must be in the box.
    candidates
        Views to keep at most.
    views_seed
        Random seed of distances and tilts.
    """

    mesh: Path | None = None
    mesh_unit: Literal["mm", "cm", "m", "inch"] | None = None
    reach: Annotated[
        str | None, Parameter(metavar="X:X,Y:Y,Z:Z|PLAN", allow_leading_hyphen=True)
    ] = None
    reach_of: Literal["camera", "tcp"] = "camera"
    candidates: Annotated[PositiveInt, Parameter(("--count", "--candidates"))] = 48
    views_seed: int = 0

    def viewpoints(
        self, part: Part, sensor: ActiveSensor, progress: Progress = ignore_progress
    ) -> CandidateViewpoints:
        """Return the views that are found.

        Raises
        ------
        UsageError
            If the reach is neither a box nor a plan.
        ExposightError
            If a file cannot be used, or no view sees a feature.
        """
        mesh, unit = None, "mm"
        if self.mesh is not None:
            unit = self.mesh_unit or unit_of(self.mesh)
            mesh = read_mesh(self.mesh, unit)
        return candidate_views(
            part,
            sensor,
            mesh=mesh,
            mesh_unit=unit,
            reach=self._reach(part),
            count=self.candidates,
            seed=self.views_seed,
            progress=progress,
        )

    def _reach(self, part: Part) -> ReachBox | dict[str, RigidTransform] | None:
        if self.reach is None:
            return None
        if ":" not in self.reach:
            return {view.name: view.camera_from_part for view in plan_from(self.reach).views(part)}
        try:
            ranges = [tuple(map(float, side.split(":"))) for side in self.reach.split(",")]
            (x0, x1), (y0, y1), (z0, z1) = ranges
        except ValueError:
            msg = (
                "--reach takes a box X1:X2,Y1:Y2,Z1:Z2 in mm, as -500:500,-300:300,400:900, or a "
                f"measuring plan; got {self.reach!r}"
            )
            raise UsageError(msg) from None
        return ReachBox(low_mm=(x0, y0, z0), high_mm=(x1, y1, z1), point=self.reach_of)


def auto_candidate_views(
    part: Part,
    sensor: ActiveSensor,
    options: AutoViewOptions,
    progress: Progress = ignore_progress,
) -> tuple[CandidateViews, Sequence[str]]:
    """Return views that are found by themselves, as candidates, and remarks on them.

    Parameters
    ----------
    part : Part
        Its features are to be seen.
    sensor : ActiveSensor
        Which looks.
    options : AutoViewOptions
    progress : Progress

    Raises
    ------
    UsageError, ExposightError
        As `AutoViewOptions.viewpoints`.
    """
    found = options.viewpoints(part, sensor, progress)
    frames = [each.view(part, sensor).frame for each in found.views]
    rings = pl.concat(frames, how="diagonal_relaxed")
    candidates = CandidateViews(
        source=AUTO,
        # a feature list does not tell the part's name, by which models know it
        frame=rings.with_columns(part=pl.lit(None, pl.String)),
        sensor=sensor,
        poses={name: (AUTO, pose) for name, pose in found.poses.items()},
        hidden=found.unreachable,
    )
    return candidates, found.notes
