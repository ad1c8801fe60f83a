"""Where recordings and reference values are (both may be absent); small scenes and their plan."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay

from exposight.cell import ActiveSensor, Feature, Part, Projector, sensor_preset
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.measuring import measure
from exposight.plans import DepthPlane, MeasuringPlan
from exposight.twin import Scene, SimulatedCell, SimulatedCellSettings, export_scene
from exposight.twin.part import FINISHES, check_scene

_REPOSITORY = Path(__file__).resolve().parent.parent


def _folder(variable: str, default: Path, what: str) -> Path:
    folder = Path(os.environ.get(variable, default))
    if not folder.is_dir():
        pytest.skip(f"{what} not found: set {variable} to their folder")
    return folder


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of recorded stripe images; the test is skipped where it is absent."""
    default = _REPOSITORY.parent / "shared" / "data" / "real"
    return _folder("EXPOSIGHT_REAL_DATA", default, "the real recordings were")


@pytest.fixture(scope="session")
def reference_data() -> Path:
    """Folder of values computed by other software; the test is skipped where it is absent."""
    default = _REPOSITORY.parent / "shared" / "data" / "reference"
    return _folder("EXPOSIGHT_REFERENCE_DATA", default, "the reference values were")


@dataclass(frozen=True)
class Ended:
    """How a command ended and what it printed."""

    exit_code: int
    stdout: str
    stderr: str


@pytest.fixture(scope="session")
def run() -> Callable[..., Ended]:
    """Run the command line in this process, on a terminal of 80 columns."""
    from exposight.cli import main

    def invoke(*arguments: object) -> Ended:
        stdout, stderr = io.StringIO(), io.StringIO()
        with redirect_stdout(stdout), redirect_stderr(stderr):
            try:
                status = main([str(argument) for argument in arguments])
            except SystemExit as end:
                status = int(end.code or 0)
        return Ended(status, stdout.getvalue(), stderr.getvalue())

    return invoke


@pytest.fixture(scope="session")
def run_json(run: Callable[..., Ended]) -> Callable[..., dict[str, Any]]:
    """Run with --json and return the object, which must be all of standard output."""

    def invoke(*arguments: object) -> dict[str, Any]:
        ended = run(*arguments, "--json")
        assert ended.exit_code == 0, ended.stdout + ended.stderr
        return json.loads(ended.stdout)

    return invoke


_MIDDLE = Feature(name="middle", kind="hole", part_from_feature=RigidTransform(), radius_mm=1.0)


def _plate(
    finish: str,
    holes: tuple[tuple[float, float, float], ...] = (),
    *,
    half_mm: tuple[float, float] = (60.0, 45.0),
    step_mm: float = 4.0,
    wall_at_mm: float | None = None,
) -> Scene:
    x = np.linspace(-half_mm[0], half_mm[0], int(2 * half_mm[0] / step_mm) + 1)
    y = np.linspace(-half_mm[1], half_mm[1], int(2 * half_mm[1] / step_mm) + 1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    for cx, cy, radius in holes:
        points = points[np.hypot(points[:, 0] - cx, points[:, 1] - cy) > radius + 0.5 * step_mm]
    for cx, cy, radius in holes:
        angle = np.arange(72) * 2 * np.pi / 72
        ring = np.stack([cx + radius * np.cos(angle), cy + radius * np.sin(angle)], axis=-1)
        points = np.concatenate([points, ring])
    faces = Delaunay(points).simplices.astype(np.int32)
    middle = points[faces].mean(axis=1)
    keep = np.ones(len(faces), dtype=bool)
    for cx, cy, radius in holes:
        keep &= np.hypot(middle[:, 0] - cx, middle[:, 1] - cy) > radius
    faces = faces[keep][:, ::-1]  # Delaunay's triangles look along z
    vertices = np.column_stack([points, np.zeros(len(points))])
    if wall_at_mm is not None:
        wall = np.array([(wall_at_mm, s * half_mm[1], z) for s in (-1, 1) for z in (0.0, -50.0)])
        n = len(vertices)
        vertices = np.concatenate([vertices, wall])
        faces = np.concatenate([faces, np.array([[n, n + 2, n + 1], [n + 1, n + 2, n + 3]])])
    return Scene(
        vertices=vertices,
        faces=faces.astype(np.int32),
        face_finish=np.full(len(faces), FINISHES.index(finish), dtype=np.uint8),
        part=Part(name="sheet", features=(_MIDDLE,)),
    )


@pytest.fixture(scope="session")
def plate() -> Callable[..., Scene]:
    """Build a sheet in the plane z = 0 that looks along −z, with or without a wall."""
    return _plate


@pytest.fixture(scope="session")
def small_sensor() -> ActiveSensor:
    """The paper's structured-light sensor with a camera of a quarter of the field and pixels."""
    full = sensor_preset("comet-pro-ae")
    camera = PinholeCamera(
        width=400, height=300, fx=full.camera.fx * 0.6, fy=full.camera.fy * 0.6, cx=199.5, cy=149.5
    )
    return replace(full, cameras=(camera,))


@pytest.fixture(scope="session")
def before() -> Callable[..., RigidTransform]:
    """Stand before the sheet, its normal turned by (w, p) from the sensor's axis."""

    def pose(distance_mm: float = 600.0, w_deg: float = 6.0, p_deg: float = -1.0) -> RigidTransform:
        return RigidTransform.from_fanuc_wpr((0.0, 0.0, distance_mm), w_deg, p_deg, 0.0)

    return pose


@pytest.fixture(scope="session")
def hole_part() -> Callable[..., Part]:
    """Give a sheet's holes names."""

    def build(holes: tuple[tuple[float, float, float], ...]) -> Part:
        return Part(
            name="sheet",
            features=tuple(
                Feature(
                    name=f"h{i}",
                    kind="hole",
                    part_from_feature=RigidTransform(translation_mm=np.array([x, y, 0.0])),
                    radius_mm=r,
                )
                for i, (x, y, r) in enumerate(holes)
            ),
        )

    return build


@pytest.fixture(scope="session")
def with_lens() -> Callable[[ActiveSensor], ActiveSensor]:
    """Give a sensor's camera and projector lens distortion."""

    def distorted(sensor: ActiveSensor) -> ActiveSensor:
        camera = replace(sensor.camera, distortion=(-0.12, 0.08, 0.001, -0.0005))
        assert sensor.projector is not None
        lamp = replace(sensor.projector.camera, distortion=(0.05, -0.02, 0.0, 0.001))
        projector = Projector(
            camera=lamp, camera_from_projector=sensor.projector.camera_from_projector
        )
        return replace(sensor, cameras=(camera,), projector=projector)

    return distorted


# -- a sheet that is measured by plan -----------------------------------------------------------

HOLES = ((-25.0, -12.0, 4.0), (15.0, 10.0, 7.0))


def _thickened(sheet, part, thickness_mm=2.0) -> Scene:
    """Give a sheet, which faces −z, a back and edges."""
    n = len(sheet.vertices)
    edges = np.concatenate([sheet.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    there = set(map(tuple, edges.tolist()))
    rim = np.array([(a, b) for a, b in there if (b, a) not in there])
    a, b = rim.T
    walls = np.concatenate([np.column_stack([b, a, a + n]), np.column_stack([b, a + n, b + n])])
    faces = np.concatenate([sheet.faces, sheet.faces[:, ::-1] + n, walls])
    return check_scene(
        Scene(
            vertices=np.concatenate([sheet.vertices, np.add(sheet.vertices, [0, 0, thickness_mm])]),
            faces=faces,
            face_finish=np.full(len(faces), sheet.face_finish[0]),
            part=part,
        )
    )


@pytest.fixture(scope="session")
def sheet_plan() -> MeasuringPlan:
    """Two holes in four views at two exposure times.

    p_norm is partly between 0 and 1 at both: darkness at one, clipping at the other.
    """
    return MeasuringPlan(
        name="sheet",
        sensor=sensor_preset("comet-pro-ae"),
        features=("h0", "h1"),
        reference="h0",
        planes=(
            DepthPlane(
                name="middle",
                z_tcp_mm=-5.0,
                x_mm=(-60.0, 60.0),
                y_mm=(-30.0, 30.0),
                exposures_ms=(30.0, 330.0),
            ),
        ),
        seed=1,
        simulated={"kinematic_share": {"middle": 0.5}},
    )


@pytest.fixture(scope="session")
def one_view(sheet_plan: MeasuringPlan) -> MeasuringPlan:
    """The first view of the plan: it has the same name, and so the same errors and noise."""
    plane = replace(sheet_plan.planes[0], x_mm=(-60.0,), y_mm=(-30.0,))
    return replace(sheet_plan, planes=(plane,))


@pytest.fixture(scope="session")
def sheet_scene(tmp_path_factory, plate, hole_part) -> Callable[[str], Path]:
    """Export the sheet with its holes in a finish."""

    def export(finish: str) -> Path:
        folder = tmp_path_factory.mktemp(finish)
        scene = _thickened(plate(finish, HOLES), hole_part(HOLES))
        export_scene(folder, scene, sensor_preset("comet-pro-ae"))
        return folder

    return export


@pytest.fixture(scope="session")
def scene(sheet_scene) -> Path:
    """The sheet with primer on it."""
    return sheet_scene("primer")


@pytest.fixture(scope="session")
def cell(scene) -> Callable[..., SimulatedCell]:
    """The simulated cell before the sheet, for a plan; rings only, unless told otherwise."""

    def build(plan: MeasuringPlan, **changes: object) -> SimulatedCell:
        return SimulatedCell.for_plan(plan, **{"rings_only": True, "scene": scene, **changes})

    return build


@pytest.fixture(scope="session")
def stereo_cell(scene) -> SimulatedCell:
    """Two rectified cameras of few pixels and a projector of dots before the sheet."""
    full = sensor_preset("rc-visard-65")
    camera = replace(full.camera, width=480, height=208, cx=280.0, cy=103.5)
    sensor = replace(full, name="small rc_visard", cameras=(camera, camera))
    return SimulatedCell(sensor, SimulatedCellSettings(scene=scene), seed=3)


@pytest.fixture(scope="session")
def alone(tmp_path_factory, sheet_plan, cell) -> Path:
    """The whole plan by one worker, uninterrupted, rings only."""
    folder = tmp_path_factory.mktemp("alone") / "sheet"
    return measure(sheet_plan, cell(sheet_plan), folder).path


@pytest.fixture
def reports() -> Reports:
    """A progress that remembers."""
    return Reports()


class Reports(list[tuple[int, int]]):
    """Captures done and in all, each time that a measurement told; and its stages."""

    def __init__(self) -> None:
        super().__init__()
        self.stages: list[str] = []

    def __call__(self, stage: str, done: int, total: int) -> None:
        if stage == "measuring":
            self.append((done, total))
        if stage not in self.stages:
            self.stages.append(stage)


@pytest.fixture(scope="session")
def content() -> Callable[[Path], dict[str, bytes]]:
    """Read all files below a folder."""

    def read(folder: Path) -> dict[str, bytes]:
        files = (path for path in folder.rglob("*") if path.is_file())
        return {str(path.relative_to(folder)): path.read_bytes() for path in files}

    return read
