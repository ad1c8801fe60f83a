"""From a scanner's folder to a plan: a folder as a metrologist has it, and the commands it takes.

The simulated cell looks at the door; images and clouds are saved as a scanner saves them, features
as Excel in Germany, poses as a KUKA robot's, the calibration as OpenCV's. Nothing of exposight's
own files is among them.
"""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from exposight.cell import ActiveSensor, Capture, Part, sensor_preset
from exposight.cli import main
from exposight.geometry import PinholeCamera, ProjectorCamera, RigidTransform
from exposight.observing.observe import Observer
from exposight.twin import SimulatedCell
from exposight.twin.cell_settings import SimulatedCellSettings

TIMES_MS = (5, 12, 30, 70, 160)
VIEWS = 8
_SCALE = 0.5
"""Of the paper's sensor's images, a side: the folder is written in seconds."""


def coarser_sensor(name: str, scale: float = _SCALE) -> ActiveSensor:
    """Return one of the paper's sensors with fewer pixels over the same field."""
    sensor = sensor_preset(name)

    def scaled(camera: PinholeCamera) -> PinholeCamera:
        return replace(
            camera,
            width=int(camera.width * scale),
            height=int(camera.height * scale),
            fx=camera.fx * scale,
            fy=camera.fy * scale,
            cx=(camera.cx + 0.5) * scale - 0.5,
            cy=(camera.cy + 0.5) * scale - 0.5,
        )

    return replace(sensor, cameras=tuple(map(scaled, sensor.cameras)))


def write_folder(folder: Path) -> dict[tuple[str, float], float]:
    """Write such a folder; return the mean p_norm of each view and exposure time.

    Parameters
    ----------
    folder : Path
        Gets ``scan/P01_5ms.png`` and ``.ply`` and so on, ``Merkmale.csv``, ``poses.src``,
        ``hand_eye.txt``, ``part.txt`` and ``calibration.yml``.
    """
    sensor = coarser_sensor("comet-pro-ae")
    cell = SimulatedCell(sensor, SimulatedCellSettings(), seed=7)
    part = Part(name="door", features=tuple(f for f in cell.part.features if f.kind == "hole"))
    (folder / "scan").mkdir(parents=True)
    hand_eye = RigidTransform.from_fanuc_wpr((30.0, -70.0, 115.0), 2.0, -3.0, 90.5)
    base_from_part = RigidTransform.from_fanuc_wpr((1200.0, 150.0, 320.0), 4.0, -2.0, 35.0)
    program, truth = ["DEF scan()"], {}
    poses = tilted_poses(sensor, part, VIEWS, tilt_deg=20.0, seed=11)
    for number, commanded in enumerate(poses, start=1):
        name = f"P{number:02d}"
        observer = Observer(part, sensor)
        captures = [cell.capture(float(time_ms), commanded, view=name) for time_ms in TIMES_MS]
        for time_ms, capture in zip(TIMES_MS, captures, strict=True):
            _save(folder / "scan" / f"{name}_{time_ms}ms", capture)
            rows = observer.observe(capture)
            values = [row.p_norm for row in rows if row.p_norm is not None]
            truth[name, float(time_ms)] = float(np.mean(values))
        reported = captures[0].camera_from_part
        base_from_flange = base_from_part @ reported.inverse() @ hand_eye.inverse()
        turn = Rotation.from_matrix(base_from_flange.rotation).as_euler("ZYX", degrees=True)
        numbers = zip("XYZABC", (*base_from_flange.translation_mm, *turn), strict=True)
        frame = ", ".join(f"{key} {value:.6f}" for key, value in numbers)
        program.append(f"DECL E6POS X{name}={{{frame}, S 2, T 35}}")
    (folder / "poses.src").write_text("\n".join([*program, "END", ""]))
    for file, pose in (("hand_eye.txt", hand_eye), ("part.txt", base_from_part)):
        np.savetxt(folder / file, pose.to_matrix())
    _excel(folder / "Merkmale.csv", part)
    _calibration(folder / "calibration.yml", sensor)
    return truth


def tilted_poses(
    sensor: ActiveSensor, part: Part, count: int, *, tilt_deg: float, seed: int
) -> list[RigidTransform]:
    """Return poses that bring features near the TCP, tilted by up to so many degrees."""
    rng = np.random.default_rng(seed)
    poses = []
    for feature in rng.choice(np.array(part.features, dtype=object), count, replace=False):
        offset_mm, (w_deg, p_deg) = rng.uniform(-60, 60, 3), rng.uniform(-tilt_deg, tilt_deg, 2)
        tcp_from_feature = RigidTransform.from_fanuc_wpr(offset_mm, w_deg, p_deg, 0.0)
        poses.append(
            sensor.camera_from_tcp @ tcp_from_feature @ feature.part_from_feature.inverse()
        )
    return poses


def _save(path: Path, capture: Capture) -> None:
    """Save the image as PNG, the cloud as a range grid: PLY of its points, and their pixels."""
    cv2.imwrite(str(path.with_suffix(".png")), capture.image)
    points = capture.require_cloud().points
    rows, columns = points.shape[:2]
    valid = np.isfinite(points[..., 0]).ravel()
    header = (
        f"ply\nformat binary_little_endian 1.0\nobj_info num_cols {columns}\n"
        f"obj_info num_rows {rows}\nelement vertex {int(valid.sum())}\nproperty float x\n"
        f"property float y\nproperty float z\nelement range_grid {rows * columns}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    # One byte where there is no point, five where there is one.
    sizes = np.where(valid, 5, 1)
    starts = np.cumsum(sizes) - sizes
    cells = np.zeros(int(sizes.sum()), np.uint8)
    cells[starts[valid]] = 1
    index = np.arange(int(valid.sum()), dtype="<i4").view(np.uint8).reshape(-1, 4)
    for byte in range(4):
        cells[starts[valid] + 1 + byte] = index[:, byte]
    body = points.reshape(-1, 3)[valid].astype("<f4").tobytes()
    path.with_suffix(".ply").write_bytes(header.encode() + body + cells.tobytes())


def _excel(path: Path, part: Part) -> None:
    rows = ["Merkmal;Art;X [mm];Y [mm];Z [mm];I;J;K;Ø [mm]"]
    for feature in part.features:
        pose = feature.part_from_feature
        numbers = (*pose.translation_mm, *(-pose.rotation[:, 2]), 2 * feature.radius_mm)
        cells = [f"{x:.6f}".replace(".", ",") for x in numbers]
        rows.append(";".join([feature.name, "Bohrung", *cells]))
    path.write_bytes(("\r\n".join(rows) + "\r\n").encode("cp1252"))


def _calibration(path: Path, sensor: ActiveSensor) -> None:
    """Write camera and projector with names that no program is known to use."""
    if sensor.projector is None:
        msg = "the sensor has no projector"
        raise RuntimeError(msg)
    rig = ProjectorCamera(
        camera=sensor.camera,
        projector=sensor.projector.camera,
        projector_from_camera=sensor.projector.camera_from_projector.inverse(),
    )
    text = rig.to_slstudio()
    for name, other in (("Kc", "cam_matrix"), ("kc", "cam_dist"), ("Kp", "prj_matrix"),
                        ("kp", "prj_dist"), ("Rp", "R"), ("Tp", "T"),
                        ("frameWidth", "cam_width"), ("frameHeight", "cam_height"),
                        ("screenResX", "prj_width"), ("screenResY", "prj_height")):  # fmt: skip
        text = text.replace(f"\n{name}:", f"\n{other}:")
    path.write_text(text)


def commands() -> list[str]:
    """Return the commands that lead from the folder to a plan, to be run in it."""
    sensor = sensor_preset("comet-pro-ae")
    low, high = sensor.exposure.min_ms, sensor.exposure.max_ms
    near, far = sensor.working_distance_mm
    return [
        f"sensor calibration.yml --name scanner --exposures {low:g} {high:g} "
        f"--working-distance {near:g} {far:g} -o sensor.json",
        "collect scan --name P{view}_{exposure}ms --features Merkmale.csv --sensor sensor.json "
        "--poses poses.src --hand-eye hand_eye.txt --part-pose part.txt -o campaign",
        "train campaign -o models",
        "plan models --views auto --features Merkmale.csv -o plan.json",
    ]


def call(words: Sequence[str]) -> dict[str, object]:
    """Call a command and return its JSON object; a failure raises with its message."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
        status = main([*words, "--json"])
    document: dict[str, object] = json.loads(said.getvalue())
    if status:
        msg = f"exposight {' '.join(words)}: {document}"
        raise RuntimeError(msg)
    return document
