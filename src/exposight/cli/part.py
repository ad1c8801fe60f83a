"""``exposight part``: a part from CAD, its holes found, to what plan and simulate take."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Group, Parameter
from cyclopts.types import PositiveInt
from cyclopts.validators import Number
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Feature, Part, read_features, sensor_named_or_read
from exposight.cell.feature_lists.feature_matching import match_features
from exposight.cell.feature_lists.found_features import FoundFeature, Side, features_of, on_one_side
from exposight.cli.app import UsageError
from exposight.cli.measure import plan_summary
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.errors import FeatureError, first_ten
from exposight.files import spelled as spelled_name
from exposight.geometry.meshes.mesh_holes import FoundHoles, Opening, find_holes
from exposight.geometry.meshes.mesh_mending import mend_mesh
from exposight.geometry.meshes.triangle_meshes import Mesh, read_part_mesh, spelled
from exposight.planning.viewing.viewpoints import candidate_views
from exposight.plans import MeasuringPlan, PoseList, write_plan
from exposight.plans.positions import logarithmic_exposures
from exposight.tables import Column, Table, counted
from exposight.twin.part import (
    FEATURES_FILE,
    SCENE_FILE,
    Scene,
    check_scene,
    export_scene,
    exported_files,
)
from exposight.twin.part.finishes import Finishes
from exposight.workers import Progress

PAGE, PLAN = "part.html", "plan.toml"


@Parameter("*", group=Group("Holes", sort_key=2))
@dataclass(frozen=True, kw_only=True)
class HoleOptions:
    """Which holes are features, and what they are called.

    Parameters
    ----------
    features
        Your list of features (docs/formats.md): its names go to the holes at its places. What the
        list has and the part lacks is an error, the reverse a note.
    tolerance
        How far a listed place may be from the hole, mm.
    others
        With --features: holes that the list does not name are features, too.
    radius
        Least and greatest radius, of slots and cutouts half the width, mm; 0.5 and two fifths
        of the part's greatest extent by default.
    side
        From which side through holes are measured: the one that faces this direction of the part's
        frame. With --features the list's normals tell.
    sheet_normals
        Where the triangles of a surface without thickness face.
    """

    features: Path | None = None
    tolerance: Annotated[float, Parameter(metavar="MM", validator=Number(gt=0))] = 1.0
    others: bool = False
    radius: Annotated[tuple[float, float] | None, Parameter(metavar="MIN MAX")] = None
    side: Annotated[Side | None, Parameter(allow_leading_hyphen=True)] = None
    sheet_normals: Literal["outward", "inward"] = "outward"


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


_PLANNED = ("views", "exposures_ms", "captures")
_USUAL, _FIRST_PLAN = HoleOptions(), FirstPlanOptions()


def part_command(
    mesh: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o", metavar="FOLDER")],
    unit: Literal["mm", "cm", "m", "inch"] | None = None,
    name: str | None = None,
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None,
    finish: str | None = None,
    holes: HoleOptions = _USUAL,
    first: FirstPlanOptions = _FIRST_PLAN,
) -> Result:
    """Find the holes of a part from CAD, and write it for plan and simulate.

    Holes, slots, cutouts and balls are found in the mesh: where each lies on the surface, its
    outward normal, its radius, and whether it goes through. The folder is a scene: mesh, features,
    sensor and finish, which simulate --scene, plan --views auto and observe take as they are. With
    --sensor it holds a measuring plan of views that see the features, too: simulate it, train and
    plan, and the exposures are known before the first capture.

    For example:

        exposight part bracket.stl --unit mm --sensor rc-visard-65 --finish primer -o bracket

        exposight part door.step --features holes.csv -o door

    Parameters
    ----------
    mesh
        The part: .stl, .obj, .ply, .glb, or .step with the extra [cad].
    output
        Folder to write.
    unit
        Unit of the mesh, where the file does not tell it.
    name
        The part's name; by default that of its file.
    sensor
        The sensor that will look at it: a preset (comet-pro-ae, rc-visard-65) or a JSON file. A
        measuring plan for it is written, too.
    finish
        Finish of the whole part: bare, primer, paint or brushed; what the mesh says by default, and
        bare where it says nothing.
    """
    if holes.radius is not None and not 0 < holes.radius[0] < holes.radius[1]:
        msg = f"--radius takes 0 < MIN < MAX in mm, got {holes.radius[0]:g} {holes.radius[1]:g}"
        raise UsageError(msg)
    chosen_sensor = None if sensor is None else sensor_named_or_read(sensor)
    finishes = Finishes(finish=finish)
    finishes.check_names()
    with progress_bars() as progress:
        progress("reading the mesh", 0, 0)
        read = read_part_mesh(mesh, unit)
        progress("mending the mesh", 0, 0)
        mended = mend_mesh(read, str(mesh))
        search = find_holes(mended, holes.radius, progress)
        search = _sheets_turned(search, holes)
        found, notes, unlisted = _features(search, mended.mesh, holes, mesh)
        notes = [*mended.notes, *search.notes, *notes]
        part = Part(
            name=name or spelled_name(mesh.stem), features=tuple(each.feature for each in found)
        )
        scene = _scene(mended.mesh, part, finishes)
        names = exported_files(scene, with_sensor=chosen_sensor is not None)
        files = [Written.at(output / file, kind, inputs=[mesh]) for kind, file in names.items()]
        files.append(Written.at(output / PAGE, "page"))
        plan = None
        if chosen_sensor is not None:
            plan, remarks = _first_plan(part, chosen_sensor, mended.mesh, first, progress)
            notes.extend(remarks)
            files.append(Written.at(output / PLAN, "measuring plan"))
        elif first != _FIRST_PLAN:
            msg = "--views, --exposures and --exposure-range go with --sensor"
            raise UsageError(msg)
        progress("writing", 0, 0)
        export_scene(output, scene, chosen_sensor)
        if plan is not None:
            write_plan(output / PLAN, plan)
        rows = [_row(each) for each in found]
        progress("drawing", 0, 0)
        from exposight.report import write_part_page  # plotting takes a second to import

        page = output / PAGE
        write_part_page(page, scene.part, scene.vertices, scene.faces, rows, notes, unlisted)
    size = np.ptp(scene.vertices, axis=0)
    return Result(
        title=part.name,
        facts=(
            fact("size_mm", size.tolist(), " × ".join(f"{extent:.4g}" for extent in size) + " mm"),
            fact("triangles", len(scene.faces)),
            fact("features", len(found)),
            *(() if plan is None else (f for f in plan_summary(plan) if f.name in _PLANNED)),
        ),
        tables=(_table(rows),),
        notes=tuple(notes),
        files=tuple(files),
        next_step=f"plan MODELS --views auto --features {output / FEATURES_FILE}"
        if plan is None
        else f"simulate {output / PLAN} --observe -o {output / 'observations.csv'}",
    )


def _sheets_turned(search: FoundHoles, holes: HoleOptions) -> FoundHoles:
    """Turn the normals of open sheets where the caller says that they point inward."""
    n_sheet = sum(each.depth == "sheet" for each in search.openings)
    if holes.sheet_normals == "outward":
        note = (
            f"{counted(n_sheet, 'rim')} of a surface without thickness: its triangles tell which "
            "side is outward; --sheet-normals inward turns them"
        )
        return replace(search, notes=(*search.notes, note)) if n_sheet else search
    turned = [
        replace(each, normal=-each.normal) if each.depth == "sheet" else each
        for each in search.openings
    ]
    return replace(search, openings=tuple(turned))


def _features(
    search: FoundHoles, mesh: Mesh, holes: HoleOptions, source: Path
) -> tuple[list[FoundFeature], list[str], int | None]:
    """Return the features, named, remarks, and how many holes the list lacks."""
    openings = search.openings
    notes: list[str] = []
    if holes.features is not None:
        matched = match_features(
            read_features(holes.features), openings, mesh, holes.features, holes.tolerance
        )
        notes.extend(matched.notes)
        further = features_of(on_one_side(matched.others, holes.side or "z"))
        if further and holes.others:
            taken = {each.feature.name for each in matched.found}
            further = [each for each in further if each.feature.name not in taken]
            return [*matched.found, *further], notes, None
        if further:
            named = [
                f"{each.feature.kind} {_size(each.feature)} at "
                f"{spelled(each.feature.part_from_feature.translation_mm)}"
                for each in further
            ]
            notes.append(
                f"{counted(len(further), 'hole')} of the part not in {holes.features}: "
                f"{first_ten(named, ', ')}; --others takes them, too"
            )
        return list(matched.found), notes, len(further)
    found = features_of(on_one_side(openings, holes.side or "z"))
    if not found:
        msg = (
            f"{source}: no hole, slot, cutout or ball was found"
            f"{' (' + '; '.join(search.notes) + ')' if search.notes else ''}; a plan needs "
            "features: widen --radius, or give a list with --features"
        )
        raise FeatureError(msg)
    through = [each for each in found if each.opening and each.opening.depth == "through"]
    if through and holes.side is None:
        notes.append(
            f"{counted(len(through), 'through hole')} taken on the side that faces +z of the "
            "part's frame (across it +y, then +x); --side chooses another"
        )
    return found, notes, None


def _size(feature: Feature) -> str:
    if feature.length_mm is not None and feature.width_mm is not None:
        return f"of {feature.length_mm:.4g} × {feature.width_mm:.4g} mm"
    return f"of radius {feature.radius_mm:.4g} mm"


def _scene(mesh: Mesh, part: Part, finishes: Finishes) -> Scene:
    face_finish: NDArray[np.uint8] = np.zeros(len(mesh.faces), dtype=np.uint8)
    scene = Scene(
        vertices=mesh.vertices,
        faces=mesh.faces,
        face_finish=face_finish if mesh.finish is None else mesh.finish,
        part=part,
    )
    return check_scene(scene.with_finishes(finishes))


def _row(found: FoundFeature) -> dict[str, Any]:
    feature, opening = found.feature, found.opening
    x, y, z = feature.part_from_feature.translation_mm.tolist()
    nx, ny, nz = (0.0 - feature.part_from_feature.z_axis).tolist()
    return {
        "feature": feature.name,
        "kind": feature.kind,
        "x_mm": x,
        "y_mm": y,
        "z_mm": z,
        "nx": nx,
        "ny": ny,
        "nz": nz,
        "radius_mm": feature.radius_mm,
        "length_mm": feature.length_mm,
        "width_mm": feature.width_mm,
        "depth": "listed" if opening is None else _depth(opening),
        "edge": "" if opening is None else opening.edge,
        "rim_points": None if opening is None else opening.n_points,
        "residual_mm": None if opening is None else opening.rms_mm,
    }


def _depth(opening: Opening) -> str:
    if opening.depth in ("through", "blind"):
        return f"{opening.depth} {opening.depth_mm:.4g} mm"
    return opening.depth


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    columns = [
        *(Column(name=name) for name in ("feature", "kind")),
        *(Column(name=f"{axis}_mm", decimals=3) for axis in "xyz"),
        *(Column(name=name, decimals=3) for name in ("nx", "ny", "nz")),
        Column(name="radius_mm", decimals=3),
    ]
    if any(row["length_mm"] is not None for row in rows):
        columns += [
            Column(name="length_mm", label="length\nmm", decimals=2),
            Column(name="width_mm", label="width\nmm", decimals=2),
        ]
    columns += [
        Column(name="depth"),
        *([Column(name="edge")] if any(row["edge"] for row in rows) else []),
        Column(name="rim_points", label="rim\npoints"),
        Column(name="residual_mm", label="residual\nmm", decimals=4),
    ]
    return Table.of("found", rows, tuple(columns), title="Features (normals outward)")


def _first_plan(
    part: Part,
    sensor: ActiveSensor,
    mesh: Mesh,
    options: FirstPlanOptions,
    progress: Progress,
) -> tuple[MeasuringPlan, list[str]]:
    """Return a measuring plan of views that see the features, and remarks."""
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
