"""``exposight sensor``: a calibration, and what it does not hold, to a sensor's document."""

from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from exposight import geometry
from exposight.cell import ActiveSensor, ExposureRange, Projector, write_sensor
from exposight.cli.app import UsageError
from exposight.cli.result import Fact, Result, Written, fact
from exposight.errors import FormatError

_LEAST_DISTANCE_MM = 10.0
"""No sensor measures nearer only; a working distance in m says less than that."""


RectifiedOrRaw = Annotated[bool | None, Parameter(name="--rectified", negative="--raw")]


def sensor_command(
    calibration: Path,
    right: Path | None = None,
    /,
    *,
    name: str,
    exposures_ms: Annotated[tuple[float, float], Parameter("--exposures", metavar="MIN MAX")],
    working_distance_mm: Annotated[
        tuple[float, float], Parameter("--working-distance", metavar="NEAR FAR")
    ],
    output: Annotated[Path, Parameter(alias="-o")] = Path("sensor.json"),
    exposure_step_ms: Annotated[float, Parameter("--exposure-step", metavar="MS")] = 0.001,
    tcp_distance_mm: Annotated[float | None, Parameter("--tcp-distance", metavar="MM")] = None,
    rectified: RectifiedOrRaw = None,
    image_size: Annotated[tuple[int, int] | None, Parameter(metavar="W H")] = None,
    projector_size: Annotated[tuple[int, int] | None, Parameter(metavar="W H")] = None,
    projector: Path | None = None,
    projector_pose: Path | None = None,
) -> Result:
    r"""Describe a sensor from its calibration.

    A calibration holds lenses and poses. What it does not hold is given here: the sensor's name,
    its exposure times and its working distance. The result goes to --sensor of observe and train.

    For example:

        exposight sensor calibration.xml --name "my scanner" --exposures 1 500 \
          --working-distance 400 800 -o sensor.json

        exposight sensor left.yaml right.yaml --rectified --name "my stereo camera" \
          --exposures 0.1 20 --working-distance 300 900 -o sensor.json

    Parameters
    ----------
    calibration
        Camera and projector (OpenCV YAML or XML, with the names that SLStudio or procam-calibration
        use); one camera (ROS camera_info); or two cameras (OpenCV's M1 D1 M2 D2 R T).
    right
        Of two cameras: the right one's ROS camera_info, or OpenCV's file of R and T.
    name
        Name of the sensor.
    exposures_ms
        Shortest and longest exposure time, ms.
    working_distance_mm
        Nearest and farthest distance at which it measures, mm.
    output
        Sensor document to write, .json.
    exposure_step_ms
        Increment of the exposure time, ms.
    tcp_distance_mm
        From the camera to the TCP along the camera's axis, mm; the middle of the working distance
        by default.
    rectified
        What the saved images are: rectified (P of a camera_info, P1 and P2 of OpenCV, no
        distortion) or raw (K and D). Asked for where the calibration has both and they differ.
    image_size
        Width and height of the images in px, where a calibration of two cameras lacks them.
    projector_size
        Projector's width and height in px, where the calibration lacks it.
    projector
        ROS camera_info of the projector, where the calibration is of one camera.
    projector_pose
        With --projector: its pose in the camera's frame, a text file with a 4×4 matrix, mm.
    """
    if output.suffix.lower() != ".json":
        msg = f"a sensor's document ends in .json, got the name {output.name}"
        raise UsageError(msg)
    images = image_kind(rectified)
    second: tuple[geometry.PinholeCamera, geometry.RigidTransform] | None = None
    light: Projector | None = None
    if right is not None or geometry.is_stereo_file(calibration):
        if projector is not None or projector_pose is not None or projector_size is not None:
            msg = "two cameras measure without a projector's calibration: leave out --projector…"
            raise UsageError(msg)
        pair = geometry.read_stereo_cameras(calibration, right, images=images, size=image_size)
        camera, second = pair.first, (pair.second, pair.first_from_second)
    else:
        camera, light = _calibrated(calibration, images, projector_size, projector, projector_pose)
    near_mm, far_mm = working_distance_mm
    tcp_mm = (near_mm + far_mm) / 2 if tcp_distance_mm is None else tcp_distance_mm
    if not near_mm <= tcp_mm <= far_mm:
        msg = (
            f"--tcp-distance must be {near_mm:g} to {far_mm:g} mm, as --working-distance says, got "
            f"{tcp_mm:g}"
        )
        raise UsageError(msg)
    sensor = ActiveSensor(
        name=name,
        cameras=(camera,) if second is None else (camera, second[0]),
        first_from_camera=(geometry.RigidTransform(),)
        if second is None
        else (geometry.RigidTransform(), second[1]),
        projector=light,
        camera_from_tcp=geometry.RigidTransform(translation_mm=np.array([0.0, 0.0, tcp_mm])),
        exposure=ExposureRange(
            min_ms=exposures_ms[0], max_ms=exposures_ms[1], increment_ms=exposure_step_ms
        ),
        working_distance_mm=working_distance_mm,
    )
    file = Written.at(output, "sensor", inputs=(calibration, right, projector, projector_pose))
    write_sensor(output, sensor)
    metres = (
        f"a working distance of {near_mm:g} to {far_mm:g} mm: if these are metres, multiply by 1000"
    )
    return Result(
        title=f"{calibration}: {name}",
        facts=sensor_facts(sensor),
        contradictions=sensor.contradictions(),
        notes=(metres,) if far_mm < _LEAST_DISTANCE_MM else (),
        files=(file,),
    )


def sensor_facts(sensor: ActiveSensor) -> tuple[Fact, ...]:
    """Return what is known about a sensor."""
    limits, light = sensor.exposure, sensor.projector
    low, high, step = limits.min_ms, limits.max_ms, limits.increment_ms
    return (
        fact("name", sensor.name),
        fact("cameras", len(sensor.cameras)),
        *camera_facts("camera", sensor.camera),
        *_second_facts(sensor),
        fact("projector_px", None if light is None else [light.width, light.height]),
        fact("exposures_ms", [low, high, step], f"{low:g} to {high:g} in steps of {step:g}"),
        fact("working_distance_mm", list(sensor.working_distance_mm)),
        fact("tcp_mm", sensor.camera_from_tcp.translation_mm.tolist()),
        *(
            fact(f"simulated_{name}", value, _spelled(value))
            for name, value in sensor.simulated.items()
        ),
    )


def _second_facts(sensor: ActiveSensor) -> tuple[Fact, ...]:
    """Return what is known of a stereo sensor's second camera."""
    if len(sensor.cameras) == 1:
        return ()
    place_mm = sensor.first_from_camera[1].translation_mm
    baseline_mm = float(np.linalg.norm(place_mm))
    return (
        *camera_facts("second_camera", sensor.cameras[1]),
        fact("second_camera_mm", place_mm.tolist()),
        fact("baseline_mm", baseline_mm),
    )


def image_kind(rectified: bool | None) -> geometry.ImageKind | None:
    """Return what --rectified or --raw says."""
    if rectified is None:
        return None
    return "rectified" if rectified else "raw"


def _spelled(value: object) -> str | None:
    """Return a table in words; None for anything else."""
    return ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else None


def camera_facts(name: str, camera: geometry.PinholeCamera) -> tuple[Fact, ...]:
    """Return a camera's or projector's intrinsic parameters."""
    return (
        fact(f"{name}_size_px", [camera.width, camera.height]),
        fact(f"{name}_focal_px", [camera.fx, camera.fy]),
        fact(f"{name}_centre_px", [camera.cx, camera.cy]),
        fact(f"{name}_distortion", list(camera.distortion)),
    )


def _calibrated(
    path: Path,
    images: geometry.ImageKind | None,
    projector_size: tuple[int, int] | None,
    projector: Path | None,
    pose: Path | None,
) -> tuple[geometry.PinholeCamera, Projector | None]:
    """Return the camera and, where it is known, the projector."""
    nodes = geometry.read_opencv_file(path).nodes
    if any(keys.camera_matrix in nodes for keys in geometry.KNOWN_KEYS.values()):
        if projector is not None or pose is not None:
            msg = f"{path} holds the projector: leave out --projector and --projector-pose"
            raise UsageError(msg)
        rig = geometry.read_projector_camera(path, projector_size=projector_size)
        light = Projector(camera=rig.projector, camera_from_projector=rig.camera_from_projector)
        return rig.camera, light
    if not {"camera_matrix.data", "camera_matrix", "K", "k"} & set(nodes):
        msg = (
            f"{path}: expected camera and projector named as by "
            f"{' or '.join(geometry.KNOWN_KEYS)}, or a "
            "ROS camera_info, or two cameras named M1 D1 M2 D2 R T; the file has "
            f"{', '.join(nodes)}"
        )
        raise FormatError(msg)
    if (projector is None) != (pose is None):
        msg = "a projector needs both its --projector and its --projector-pose"
        raise UsageError(msg)
    camera = geometry.read_ros_camera_info(path, images)
    if projector is None or pose is None:
        return camera, None
    return camera, Projector(
        camera=geometry.read_ros_camera_info(projector, "raw"),
        camera_from_projector=geometry.read_pose(pose),
    )
