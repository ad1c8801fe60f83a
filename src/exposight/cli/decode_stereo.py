"""``exposight decode --stereo``: two cameras' images, or their stripe frames, to a cloud."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from cyclopts import Group, Parameter
from numpy.typing import NDArray

from exposight import imaging
from exposight.cell import BitDepth, sensor_named_or_read, write_cloud
from exposight.cli.app import UsageError
from exposight.cli.result import Result, Written, fact
from exposight.cli.sensor import RectifiedOrRaw, image_kind
from exposight.contradictions import Contradiction
from exposight.contradictions.contradiction import check_names
from exposight.contradictions.epipolar import ROWS
from exposight.errors import CloudError, ExposightError, SensorError
from exposight.files import write_durably
from exposight.geometry import (
    CalibrationKeys,
    ImageKind,
    PinholeCamera,
    StereoCameras,
    read_stereo_cameras,
)
from exposight.imaging.consistency import FRAME_CHECKS
from exposight.imaging.stereo_match import MatchOutcome
from exposight.tables import Column, Table, count, number

STEREO_CHECKS = (*FRAME_CHECKS, ROWS)
"""Names of the checks that may be passed over."""

_MEANINGS = {
    MatchOutcome.MATCHED: "have a point",
    MatchOutcome.NOT_DECODED: "the left camera did not read their code",
    MatchOutcome.CLIPPED: "too much at full scale round them",
    MatchOutcome.NO_TEXTURE: "hardly vary round them: too dark, or no pattern",
    MatchOutcome.NO_PARTNER: "nothing like them in the right image: hidden there, or not read",
    MatchOutcome.AMBIGUOUS: "more than one place in the right image",
    MatchOutcome.OUTSIDE: "outside the depth limits",
}
_MIDDLE = (0.25, 0.75)
"""Shares of width and height between which principal points lie, unless the image is another."""


@Parameter("*", group=Group("Two cameras instead of a projector's calibration", sort_key=3))
@dataclass(frozen=True, kw_only=True)
class StereoOptions:
    """What the command line says of a stereo pair.

    Parameters
    ----------
    stereo
        Images of the left and the right camera, or folders of frames that both took of the same
        patterns (with --sequence).
    sensor
        Sensor with two cameras: JSON file or preset (rc-visard-65), in place of --calibration.
    right_calibration
        With --calibration of the left camera (ROS camera_info): the right one's; or OpenCV's R and
        T, where they have a file of their own.
    rectified
        What the images are: rectified, or raw as recorded. Asked for where the calibration
        describes both.
    downsample
        Match images at 1, 1/2 or 1/4 of their resolution.
    bit_depth
        Bit depth of the images (8 by default).
    """

    stereo: Annotated[tuple[Path, Path] | None, Parameter(metavar="LEFT RIGHT")] = None
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None
    right_calibration: Path | None = None
    rectified: RectifiedOrRaw = None
    downsample: Literal[1, 2, 4] = 1
    bit_depth: BitDepth = 8

    def options(self) -> list[str]:
        """Return the options that were given."""
        return [
            f"--{name.replace('_', '-')}"
            for name, value in vars(self).items()
            if value != getattr(StereoOptions, name)
        ]


NO_PAIR = StereoOptions()


def decode_stereo(
    pair: StereoOptions,
    *,
    calibration: Path | None,
    sequence: str | None,
    output: Path | None,
    preview: Path | None,
    depth_limits_mm: tuple[float, float],
    despite: tuple[str, ...],
    limits: imaging.DecodingLimits,
    keys: CalibrationKeys | None = None,
) -> Result:
    """Match two images, or the codes that two cameras decode.

    Raises
    ------
    UsageError
        If options are missing or do not go together.
    ExposightError
        If a file cannot be used, the inputs contradict themselves, or nothing was measured.
    """
    if pair.stereo is None:
        msg = "give the left and the right image, or folder of frames, with --stereo"
        raise UsageError(msg)
    check_names(despite, STEREO_CHECKS)
    are_folders = [path.is_dir() for path in pair.stereo]
    if are_folders[0] != are_folders[1]:
        msg = "--stereo needs two images or two folders of frames, got one of each"
        raise UsageError(msg)
    if are_folders[0] and sequence is None:
        msg = "folders of frames need --sequence, which says what each frame shows"
        raise UsageError(msg)
    if sequence is not None and not are_folders[0]:
        msg = "--sequence is of folders of frames; two images need none"
        raise UsageError(msg)
    files = [
        Written.at(path, kind, inputs=pair.stereo)
        for path, kind in ((output, "cloud"), (preview, "preview"))
        if path is not None
    ]
    work = (
        _images(pair)
        if sequence is None
        else _codes(pair.stereo, imaging.sequence_named_or_read(sequence), limits, despite)
    )
    cameras = _cameras(pair, calibration, work.shape, keys)
    depth_limits_mm = _depth_limits(pair, depth_limits_mm, needed=sequence is None)
    start = time.perf_counter()
    match = work.match(cameras, depth_limits_mm, despite)
    seconds = time.perf_counter() - start
    if preview is not None:
        _write_preview(preview, match.cloud.points[..., 2])
    if not match.cloud.n_valid:
        raise CloudError(_why_empty(match.counts(), depth_limits_mm))
    if output is not None:
        write_cloud(output, match.cloud)
    depths = match.cloud.valid_points[:, 2].astype(float)
    near, middle, far = np.percentile(depths, [0, 50, 100]).tolist()
    rows, columns = match.outcome.shape
    return Result(
        title=f"{pair.stereo[0]} and {pair.stereo[1]}",
        facts=(
            fact("size_px", [columns, rows], f"{columns} × {rows}"),
            fact("baseline_mm", cameras.rectified.baseline_mm),
            fact("depth_limits_mm", list(depth_limits_mm)),
            fact("points", match.cloud.n_valid, f"{count(match.cloud.n_valid)} in {seconds:.2f} s"),
            fact("seconds", seconds, ""),
            fact(
                "depth_mm",
                {"min": near, "median": middle, "max": far},
                f"{number(near)} to {number(far)} mm, median {number(middle)} mm",
            ),
        ),
        tables=(_pixel_table(match.counts(), by_codes=sequence is not None),),
        contradictions=tuple(dict.fromkeys((*work.contradictions, *match.contradictions))),
        notes=() if files else ("nothing was written: --output keeps the cloud",),
        files=tuple(files),
    )


@dataclass(frozen=True, kw_only=True)
class _Work:
    """What is to be matched, once the cameras are known."""

    shape: tuple[int, int]
    match: Callable[[_Cameras, tuple[float, float], tuple[str, ...]], imaging.StereoMatch]
    contradictions: tuple[Contradiction, ...] = ()


def _images(pair: StereoOptions) -> _Work:
    assert pair.stereo is not None
    first, second = (_grey(path, pair.bit_depth) for path in pair.stereo)

    def match(
        cameras: _Cameras, depth_limits_mm: tuple[float, float], despite: tuple[str, ...]
    ) -> imaging.StereoMatch:
        return imaging.stereo_by_images(
            first,
            second,
            cameras.rectified,
            depth_limits_mm=depth_limits_mm,
            downsample=pair.downsample,
            others=cameras.others,
            despite=despite,
        )

    rows, columns = first.shape
    return _Work(shape=(rows, columns), match=match)


def _grey(path: Path, bit_depth: BitDepth) -> NDArray[np.uint8]:
    """Read an image in grey levels 0–255."""
    stack = imaging.read_frames([path], bit_depth=bit_depth)
    frame = stack.frames[0]
    if frame.dtype == np.uint8:
        return np.asarray(frame, dtype=np.uint8)
    # Rounded down: only full scale stays full scale.
    return np.asarray(frame * (255.0 / stack.full_scale), dtype=np.uint8)


def _codes(
    folders: tuple[Path, Path],
    patterns: imaging.PatternSequence,
    limits: imaging.DecodingLimits,
    despite: tuple[str, ...],
) -> _Work:
    first, second = (
        imaging.decode(imaging.read_recording(each, patterns), patterns, limits, despite=despite)
        for each in folders
    )

    def match(
        cameras: _Cameras, depth_limits_mm: tuple[float, float], despite: tuple[str, ...]
    ) -> imaging.StereoMatch:
        return imaging.stereo_by_codes(
            first, second, cameras.rectified, depth_limits_mm=depth_limits_mm, despite=despite
        )

    return _Work(
        shape=first.image_shape,
        match=match,
        contradictions=(*first.contradictions, *second.contradictions),
    )


# -- cameras ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Cameras:
    rectified: imaging.RectifiedPair
    others: Mapping[str, imaging.RectifiedPair]
    """What else the cameras may be, by the option that says so."""


def _cameras(
    pair: StereoOptions,
    calibration: Path | None,
    shape: tuple[int, ...],
    keys: CalibrationKeys | None,
) -> _Cameras:
    """Return the pair of --sensor, or of --calibration."""
    if (pair.sensor is None) == (calibration is None):
        msg = "two cameras are described by --sensor or by --calibration: give one of both"
        raise UsageError(msg)
    if pair.sensor is not None:
        if pair.right_calibration is not None or pair.rectified is not None:
            msg = "--right-calibration, --rectified and --raw go with --calibration, not --sensor"
            raise UsageError(msg)
        sensor = sensor_named_or_read(pair.sensor)
        if len(sensor.cameras) != 2:
            msg = (
                f"sensor {sensor.name!r} has {len(sensor.cameras)} camera; a stereo pair needs two "
                "(exposight sensor LEFT.yaml RIGHT.yaml makes such a sensor)"
            )
            raise SensorError(msg)
        return _Cameras(
            rectified=imaging.rectify(*sensor.cameras, sensor.first_from_camera[1]), others={}
        )
    assert calibration is not None
    files = (calibration, pair.right_calibration)
    size = (shape[1], shape[0])
    images = image_kind(pair.rectified)
    cameras = read_stereo_cameras(*files, keys=keys, images=images, size=size)
    for camera in (cameras.first, cameras.second):
        _check_principal_point(camera, calibration)
    other: ImageKind = "raw" if cameras.images == "rectified" else "rectified"
    try:
        others = {
            f"--{other}": _pair(read_stereo_cameras(*files, keys=keys, images=other, size=size))
        }
    except ExposightError:  # not in the calibration
        others = {}
    return _Cameras(rectified=_pair(cameras), others=others)


def _pair(cameras: StereoCameras) -> imaging.RectifiedPair:
    return imaging.rectify(cameras.first, cameras.second, cameras.first_from_second)


def _check_principal_point(camera: PinholeCamera, path: Path) -> None:
    """Refuse images of another size than a calibration that holds none."""
    shares = (camera.cx / camera.width, camera.cy / camera.height)
    if all(_MIDDLE[0] <= share <= _MIDDLE[1] for share in shares):
        return
    msg = (
        f"{path}: a principal point of ({camera.cx:.0f}, {camera.cy:.0f}) px is far from the "
        f"middle of images of {camera.width} × {camera.height} px; use the calibration of these "
        "images, at the same resolution and not cropped"
    )
    raise SensorError(msg)


def _depth_limits(
    pair: StereoOptions, depth_limits_mm: tuple[float, float], *, needed: bool
) -> tuple[float, float]:
    """Return --depth-limits, or the sensor's working distance."""
    if depth_limits_mm != (0.0, np.inf):
        return depth_limits_mm
    if pair.sensor is not None:
        return sensor_named_or_read(pair.sensor).working_distance_mm
    if needed:
        msg = "matching images needs --depth-limits NEAR FAR in mm: between them it searches"
        raise UsageError(msg)
    return depth_limits_mm


# -- what is shown ------------------------------------------------------------------------------


def _pixel_table(counts: Mapping[MatchOutcome, int], *, by_codes: bool) -> Table:
    """Return how many pixels have a point, and why the others have none."""
    foreign = (
        {MatchOutcome.CLIPPED, MatchOutcome.NO_TEXTURE}
        if by_codes
        else {MatchOutcome.NOT_DECODED, MatchOutcome.AMBIGUOUS}
    )
    total = sum(counts.values())
    return Table.of(
        "pixels",
        (
            {
                "pixels": outcome.name.lower().replace("_", " "),
                "count": counts[outcome],
                "share": counts[outcome] / total,
                "meaning": meaning,
            }
            for outcome, meaning in _MEANINGS.items()
            if outcome not in foreign
        ),
        (
            Column(name="pixels"),
            Column(name="count"),
            Column(name="share", label="share %", scale=100, decimals=1),
            Column(name="meaning", wraps=True),
        ),
    )


def _why_empty(counts: Mapping[MatchOutcome, int], depth_limits_mm: tuple[float, float]) -> str:
    """Return why a cloud has no point: what became of most pixels."""
    outcome = max(counts, key=lambda each: counts[each])
    near_mm, far_mm = depth_limits_mm
    what_to_do = {
        MatchOutcome.NOT_DECODED: "check the sequence and the exposure time",
        MatchOutcome.CLIPPED: "take a shorter exposure time",
        MatchOutcome.NO_TEXTURE: "take a longer exposure time, or project a pattern",
        MatchOutcome.NO_PARTNER: "check that both images are of the same moment and these "
        f"cameras, left first, and that the scene is within {near_mm:g} to {far_mm:g} mm",
    }.get(outcome, f"widen the depth limits, {near_mm:g} to {far_mm:g} mm")
    return (
        f"no point: of {count(sum(counts.values()))} pixels {count(counts[outcome])} "
        f"({_MEANINGS[outcome]}); {what_to_do}"
    )


def _write_preview(path: Path, depth_mm: NDArray[np.floating]) -> None:
    """Write the depth as a coloured PNG: near red, far blue, black where there is no point."""
    valid = np.isfinite(depth_mm)
    grey = np.zeros(depth_mm.shape, dtype=np.uint8)
    if valid.any():
        near, far = np.percentile(depth_mm[valid], [1, 99])
        share = (far - depth_mm[valid]) / max(far - near, 1e-6)
        grey[valid] = (255.0 * share).clip(0, 255).astype(np.uint8)
    coloured = cv2.applyColorMap(grey, cv2.COLORMAP_TURBO)
    coloured[~valid] = 0
    _, png = cv2.imencode(".png", coloured)
    write_durably(path, png.tobytes())
