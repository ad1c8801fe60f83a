"""``exposight sensor``: a calibration and what it does not tell, to a sensor's document."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from exposight.cell import ActiveSensor, ExposureRange, Projector, write_sensor
from exposight.cli.facts import sensor_facts
from exposight.cli.output import JsonOption, note, number, print_facts, print_json, print_line
from exposight.cli.recordings import is_camera_info
from exposight.errors import FormatError, SensorError
from exposight.geometry import (
    KNOWN_KEYS,
    PinholeCamera,
    RigidTransform,
    read_opencv_file,
    read_pose,
    read_projector_camera,
    read_ros_camera_info,
)

_LEAST_BASELINE_MM = 2.0
"""No projector stands nearer to its camera; a calibration in m says less than that."""

_LEAST_DISTANCE_MM = 10.0
"""No sensor measures nearer only; a working distance in m says less than that."""

_Calibration = Annotated[
    Path,
    typer.Argument(
        metavar="CALIBRATION",
        help="Camera and projector (OpenCV YAML or XML, named as by SLStudio or "
        "procam-calibration), or one camera (ROS camera_info).",
    ),
]
_Name = Annotated[str, typer.Option(metavar="TEXT", help="What people call the sensor.")]
_Exposures = Annotated[
    tuple[float, float],
    typer.Option(metavar="MIN MAX", help="Shortest and longest exposure time, ms."),
]
_Step = Annotated[
    float, typer.Option(metavar="MS", help="Step between settings of the exposure time, ms.")
]
_Distance = Annotated[
    tuple[float, float],
    typer.Option(metavar="NEAR FAR", help="Nearest and farthest distance it measures at, mm."),
]
_TcpDistance = Annotated[
    float | None,
    typer.Option(
        metavar="MM",
        help="From the camera to the TCP, along the camera's axis, mm: the middle of the working "
        "distance, if not given.",
    ),
]
_ProjectorSize = Annotated[
    tuple[int, int] | None,
    typer.Option(
        metavar="W H", help="Projector's width and height, px, where the calibration has none."
    ),
]
_Projector = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="The projector as a ROS camera_info of its own, where CALIBRATION is of one camera.",
    ),
]
_ProjectorPose = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="With --projector: its pose in the camera's frame, a text file, 4×4 matrix, mm.",
    ),
]
_Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE", help="The sensor's document, .json.")
]


def sensor_command(
    calibration: _Calibration,
    name: _Name,
    exposures: _Exposures,
    working_distance: _Distance,
    output: _Output = Path("sensor.json"),
    exposure_step: _Step = 0.001,
    tcp_distance: _TcpDistance = None,
    projector_size: _ProjectorSize = None,
    projector: _Projector = None,
    projector_pose: _ProjectorPose = None,
    as_json: JsonOption = False,
) -> None:
    r"""Describe a sensor by its calibration, for the other commands.

    A calibration holds lenses and poses. What it does not hold is asked for
    here: the sensor's name, the exposure times that it can take, and where it
    measures. The result goes to --sensor of observe and train.

    For example:

      exposight sensor calibration.xml --name "my scanner" --exposures 1 500 \
        --working-distance 400 800 -o sensor.json
    """
    if output.suffix.lower() != ".json":
        msg = f"a sensor's document ends in .json, got the name {output.name}"
        raise typer.BadParameter(msg, param_hint="--output")
    camera, own = _calibrated(calibration, projector_size, projector, projector_pose)
    near_mm, far_mm = working_distance
    tcp_mm = (near_mm + far_mm) / 2 if tcp_distance is None else tcp_distance
    if not near_mm <= tcp_mm <= far_mm:
        msg = f"expected {near_mm:g} to {far_mm:g} mm, as --working-distance says, got {tcp_mm:g}"
        raise typer.BadParameter(msg, param_hint="--tcp-distance")
    sensor = ActiveSensor(
        name=name,
        cameras=(camera,),
        first_from_camera=(RigidTransform(),),
        projector=own,
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, tcp_mm])),
        exposure=ExposureRange(
            min_ms=exposures[0], max_ms=exposures[1], increment_ms=exposure_step
        ),
        working_distance_mm=working_distance,
    )
    write_sensor(output, sensor)
    facts = sensor_facts(sensor)
    remark = ""
    if far_mm < _LEAST_DISTANCE_MM:
        remark = (
            f"a working distance of {near_mm:g} to {far_mm:g} mm: mm are expected; if these are "
            "metres, multiply by 1000 (exposure times are in ms)"
        )
    if as_json:
        told = {fact.name.replace(" ", "_"): fact.value for fact in facts}
        print_json({"calibration": calibration, "facts": told, "remark": remark, "sensor": output})
        return
    print_facts(f"{calibration}: {name}", [(fact.name, fact.text) for fact in facts])
    if remark:
        note(remark)
    print_line(f"wrote the sensor: {output}")


def _calibrated(
    path: Path, projector_size: tuple[int, int] | None, projector: Path | None, pose: Path | None
) -> tuple[PinholeCamera, Projector | None]:
    """Return the camera and, where it is known, the projector."""
    file = read_opencv_file(path)
    if any(keys.camera_matrix in file.nodes for keys in KNOWN_KEYS.values()):
        if projector is not None or pose is not None:
            msg = f"{path} holds the projector: leave out --projector and --projector-pose"
            raise typer.BadParameter(msg)
        rig = read_projector_camera(path, projector_size=projector_size)
        return rig.camera, _projector(rig.projector, rig.camera_from_projector, path)
    if not is_camera_info(file):
        msg = (
            f"{path}: expected camera and projector named as by {' or '.join(KNOWN_KEYS)}, or a "
            f"ROS camera_info; the file has {', '.join(file.nodes)}"
        )
        raise FormatError(msg)
    if (projector is None) != (pose is None):
        msg = "a projector needs both its --projector and its --projector-pose"
        raise typer.BadParameter(msg)
    camera = read_ros_camera_info(path)
    if projector is None or pose is None:
        return camera, None
    return camera, _projector(read_ros_camera_info(projector), read_pose(pose), pose)


def _projector(
    camera: PinholeCamera, camera_from_projector: RigidTransform, path: Path
) -> Projector:
    baseline_mm = float(np.linalg.norm(camera_from_projector.translation_mm))
    if baseline_mm < _LEAST_BASELINE_MM:
        msg = (
            f"{path}: camera and projector stand {number(baseline_mm)} mm apart, which cannot be: "
            "is the translation in m? multiply it by 1000"
        )
        raise SensorError(msg)
    return Projector(camera=camera, camera_from_projector=camera_from_projector)
