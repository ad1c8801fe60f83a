"""``exposight sensor``: a calibration, and what it does not hold, to a sensor's document."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Group, Parameter

from exposight import geometry
from exposight.cell import ActiveSensor, ExposureRange, Projector, write_sensor
from exposight.cli.app import UsageError
from exposight.cli.result import Fact, Result, Written, fact

_LEAST_DISTANCE_MM = 10.0
"""No sensor measures nearer only; a working distance in m says less than that."""


RectifiedOrRaw = Annotated[bool | None, Parameter(name="--rectified", negative="--raw")]


Keys = Annotated[str | None, Parameter(metavar="ENTRY=NODE,…")]


@Parameter("*", group=Group("Without a calibration", sort_key=3))
@dataclass(frozen=True, kw_only=True)
class UncalibratedOptions:
    """What is known of a camera without a calibration.

    Parameters
    ----------
    resolution
        Width and height of the images in px.
    field_of_view_mm
        Width and height of what the images show, and at which distance, mm.
    field_of_view_deg
        Horizontal and vertical field of view, degrees.
    focal_length_mm
        The lens's focal length in mm; with --pixel-size.
    pixel_size_um
        Distance between pixels in µm; twice that of the data sheet with 2 × 2 binning.
    """

    resolution: Annotated[tuple[int, int] | None, Parameter(metavar="W H")] = None
    field_of_view_mm: Annotated[
        tuple[float, float, float] | None, Parameter("--field-of-view", metavar="W H DISTANCE")
    ] = None
    field_of_view_deg: Annotated[tuple[float, float] | None, Parameter(metavar="H V")] = None
    focal_length_mm: Annotated[float | None, Parameter("--focal-length", metavar="MM")] = None
    pixel_size_um: Annotated[float | None, Parameter("--pixel-size", metavar="UM")] = None

    def options(self) -> list[str]:
        """Return the options that were given."""
        spelled = {
            "resolution": "--resolution",
            "field_of_view_mm": "--field-of-view",
            "field_of_view_deg": "--field-of-view-deg",
            "focal_length_mm": "--focal-length",
            "pixel_size_um": "--pixel-size",
        }
        return [option for name, option in spelled.items() if getattr(self, name) is not None]

    def camera(self) -> geometry.PinholeCamera:
        """Return the camera that data sheets describe: centred, without distortion.

        Raises
        ------
        UsageError
            If the options are none of the ways to describe it, or two of them.
        """
        given = self.options()
        ways = (
            ["--resolution", "--field-of-view"],
            ["--resolution", "--field-of-view-deg"],
            ["--resolution", "--focal-length", "--pixel-size"],
        )
        if given not in ways or self.resolution is None:
            expected = "; or ".join(" with ".join((way[0], " and ".join(way[1:]))) for way in ways)
            msg = (
                f"give a calibration's file, or without one {expected}; got "
                f"{' '.join(given) or 'none of them'}"
            )
            raise UsageError(msg)
        if self.field_of_view_mm is not None:
            wide, high, distance = self.field_of_view_mm
            return geometry.uncalibrated_camera(
                self.resolution, field_of_view_mm=(wide, high), distance_mm=distance
            )
        if self.field_of_view_deg is not None:
            return geometry.uncalibrated_camera(
                self.resolution, field_of_view_deg=self.field_of_view_deg
            )
        assert self.focal_length_mm is not None
        assert self.pixel_size_um is not None
        return geometry.uncalibrated_camera(
            self.resolution,
            focal_length_mm=self.focal_length_mm,
            pixel_size_um=self.pixel_size_um,
        )


UNKNOWN = UncalibratedOptions()
_ROUGH = (
    "without a calibration the camera is a pinhole with its centre in the middle and no "
    "distortion: good for p_norm, views and plans of exposures, where a ring may be off by some "
    "px; not for decoding stripes, matching stereo pairs or measuring lengths"
)


def sensor_command(
    calibration: Path | None = None,
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
    keys: Keys = None,
    projector: Path | None = None,
    projector_pose: Path | None = None,
    unknown: UncalibratedOptions = UNKNOWN,
) -> Result:
    r"""Describe a sensor from its calibration.

    A calibration holds lenses and poses. What it does not hold is given here: the sensor's name,
    its exposure times and its working distance. The result goes to --sensor of observe and train.

    For example:

        exposight sensor calibration.xml --name "my scanner" --exposures 1 500 \
          --working-distance 400 800 -o sensor.json

        exposight sensor left.yaml right.yaml --rectified --name "my stereo camera" \
          --exposures 0.1 20 --working-distance 300 900 -o sensor.json

        exposight sensor --resolution 1944 1200 --field-of-view 700 430 700 --name "my scanner" \
          --exposures 1 100 --working-distance 500 1000

    Parameters
    ----------
    calibration
        Of a camera, of camera and projector, or of two cameras: YAML, XML, JSON, text, .npz or .mat
        of OpenCV, ROS, MATLAB or a scanner's program. Which node is what is recognised by shape.
    right
        A second file: the right camera's ROS camera_info, or OpenCV's extrinsics.yml of R and T.
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
        Width and height of the images in px, where the calibration lacks them.
    projector_size
        Projector's width and height in px, where the calibration lacks it; of two devices that are
        just numbered, it also says that the second is a projector.
    keys
        Which nodes of the calibration are what, where their names do not tell:
        camera_matrix=Kleft,projector_matrix=Kright,rotation=R,translation=T,camera_size=w+h
        (docs/formats.md).
    projector
        Calibration of the projector alone, where the other one is of one camera.
    projector_pose
        With --projector: its pose in the camera's frame, a text file with a 4×4 matrix, mm.
    """
    if output.suffix.lower() != ".json":
        msg = f"a sensor's document ends in .json, got the name {output.name}"
        raise UsageError(msg)
    if calibration is not None and unknown.options():
        msg = f"{calibration} is a calibration: leave out {' '.join(unknown.options())}"
        raise UsageError(msg)
    found = (
        geometry.Calibration(source="", camera=unknown.camera())
        if calibration is None
        else geometry.read_calibration(
            calibration,
            right,
            keys=None if keys is None else geometry.CalibrationKeys.parse(keys),
            images=image_kind(rectified),
            image_size=image_size,
            projector_size=projector_size,
            second=None if projector_size is None or projector is not None else "projector",
        )
    )
    if image_size is not None and (found.camera.width, found.camera.height) != image_size:
        size = f"{found.camera.width} × {found.camera.height}"
        msg = f"{calibration} is of images of {size} px; leave out --image-size"
        raise UsageError(msg)
    light = _projector(found, projector, projector_pose, projector_size)
    near_mm, far_mm = working_distance_mm
    tcp_mm = (near_mm + far_mm) / 2 if tcp_distance_mm is None else tcp_distance_mm
    if not near_mm <= tcp_mm <= far_mm:
        msg = (
            f"--tcp-distance must be {near_mm:g} to {far_mm:g} mm, as --working-distance says, got "
            f"{tcp_mm:g}"
        )
        raise UsageError(msg)
    cameras, places = [found.camera], [geometry.RigidTransform()]
    if found.second is not None and found.transform is not None:
        cameras.append(found.second)
        places.append(found.transform.inverse())
    sensor = ActiveSensor(
        name=name,
        cameras=tuple(cameras),
        first_from_camera=tuple(places),
        projector=light,
        camera_from_tcp=geometry.RigidTransform(translation_mm=np.array([0.0, 0.0, tcp_mm])),
        exposure=ExposureRange(
            min_ms=exposures_ms[0], max_ms=exposures_ms[1], increment_ms=exposure_step_ms
        ),
        working_distance_mm=working_distance_mm,
    )
    file = Written.at(output, "sensor", inputs=(calibration, right, projector, projector_pose))
    write_sensor(output, sensor)
    notes = [] if calibration is not None else [_ROUGH]
    if far_mm < _LEAST_DISTANCE_MM:
        notes.append(
            f"a working distance of {near_mm:g} to {far_mm:g} mm: if these are metres, multiply by "
            "1000"
        )
    return Result(
        title=name if calibration is None else f"{calibration}: {name}",
        facts=sensor_facts(sensor),
        contradictions=sensor.contradictions(),
        notes=tuple(notes),
        files=(file,),
    )


def _projector(
    found: geometry.Calibration,
    projector: Path | None,
    pose: Path | None,
    size: tuple[int, int] | None,
) -> Projector | None:
    """Return the projector of the calibration, or of a calibration of its own."""
    if projector is not None or pose is not None:
        if found.second is not None:
            msg = "two cameras measure without a projector's calibration: leave out --projector…"
            raise UsageError(msg)
        if found.projector is not None:
            msg = f"{found.source} holds the projector: leave out --projector and --projector-pose"
            raise UsageError(msg)
        if projector is None or pose is None:
            msg = "a projector needs both its --projector and its --projector-pose"
            raise UsageError(msg)
        return Projector(
            camera=geometry.read_calibration(projector, images="raw", image_size=size).camera,
            camera_from_projector=geometry.read_pose(pose),
        )
    if found.projector is None or found.transform is None:
        if size is not None:
            msg = "--projector-size is of a projector, and the calibration has none"
            raise UsageError(msg)
        return None
    return Projector(camera=found.projector, camera_from_projector=found.transform.inverse())


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
