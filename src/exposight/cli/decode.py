"""``exposight decode``: frames to an organised cloud."""

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from cyclopts import Parameter
from cyclopts.validators import Number
from numpy.typing import NDArray

from exposight import imaging
from exposight.cell import Cloud, write_cloud
from exposight.cli.app import UsageError
from exposight.cli.decode_stereo import NO_PAIR, StereoOptions, decode_stereo
from exposight.cli.guess_sequence import guess_result, guess_table, guessed
from exposight.cli.result import Fact, Result, Written, fact
from exposight.cli.sensor import Keys
from exposight.contradictions import settle
from exposight.contradictions.contradiction import check_names
from exposight.contradictions.intersections import INTERSECTIONS
from exposight.errors import CloudError
from exposight.files import write_durably
from exposight.geometry import (
    CalibrationKeys,
    ProjectorCamera,
    read_calibration_nodes,
    read_projector_camera,
)
from exposight.imaging.consistency import FRAME_CHECKS, map_contradiction
from exposight.tables import Column, Table, count, number

_LIMITS = imaging.DecodingLimits()
_MEANINGS = {
    "decoded": "every coded axis was read",
    "low_modulation": "unlit, or too dark",
    "clipped": "a sample at full scale",
    "ambiguous": "bits or phases disagree",
    "outside": "no place on the projector",
    "half_read": "column or row was read, the other was not: no point",
}


def decode_command(
    folder: Path | None = None,
    /,
    *,
    calibration: Annotated[Path | None, Parameter(alias="-c")] = None,
    sequence: Annotated[str | None, Parameter(alias="-s", metavar="NAME|FILE")] = None,
    guess: bool = False,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    map_file: Annotated[Path | None, Parameter("--map")] = None,
    preview: Path | None = None,
    depth_limits_mm: Annotated[
        tuple[float, float], Parameter("--depth-limits", metavar="NEAR FAR")
    ] = (0.0, np.inf),
    projector_size: Annotated[tuple[int, int] | None, Parameter(metavar="W H")] = None,
    keys: Keys = None,
    extrinsics: Path | None = None,
    despite: Annotated[tuple[str, ...], Parameter(metavar="CHECK")] = (),
    grey_noise: Annotated[float | None, Parameter(validator=Number(gt=0, lt=255))] = None,
    limits: Annotated[imaging.DecodingLimits, Parameter("*")] = _LIMITS,
    pair: StereoOptions = NO_PAIR,
) -> Result:
    """Decode recorded stripe frames, or a stereo pair, to an organised point cloud.

    Gray code or phase shift gives each camera pixel its projector column (and row, where coded);
    the point is where the pixel's ray meets the light of that column. The cloud is in mm in the
    camera's frame and keeps the image's rows and columns.

    For example:

        exposight decode scan1/ -c calibration.xml -s skull_2x3 -o cloud.ply

        exposight decode scan1/ --guess --projector-size 1824 1140 -o sequence.toml

        exposight decode scan1/ -s skull_2x3 --map map.npz

        exposight decode --stereo left.png right.png --sensor sensor.json -o cloud.ply

        exposight decode --stereo left/ right/ --sensor sensor.json -s board -o cloud.ply

    Parameters
    ----------
    folder
        Folder of recorded frames.
    calibration
        Camera, projector and the pose between them, as any program writes them (docs/formats.md).
        With --stereo, of two cameras, or the left camera's ROS camera_info.
    sequence
        What each frame shows: skull_gray, skull_2x3, board, or a TOML file.
    guess
        Propose a sequence from the frames alone, and say how sure each part of it is; with a
        calibration, decode by it.
    output
        Write the cloud to this file: .ply, .pcd, .xyz, .csv. With --guess, .toml: the sequence.
    map_file
        Write the decoded coordinates, modulation and flags to this file, .npz (docs/formats.md);
        without a calibration, that is all.
    preview
        Write a PNG of the decoded coordinate and the modulation.
    depth_limits_mm
        Leave out points nearer or farther than this, mm.
    projector_size
        Projector's width and height in px, where the calibration lacks it.
    keys
        Which nodes of the calibration are what, where their names do not tell:
        camera_matrix=Kleft,projector_matrix=Kright,rotation=R,translation=T (docs/formats.md).
    extrinsics
        The file of R and T, where the calibration has them in a file of their own.
    despite
        Go on although this check finds a contradiction between frames and sequence; repeat it for
        several.
    grey_noise
        Standard deviation of the camera's noise in grey levels of 255, from which that of each
        point follows; found from the frames themselves where a fringe has four steps or more.
    """
    near_mm, far_mm = depth_limits_mm
    if not 0 <= near_mm < far_mm:
        msg = f"--depth-limits needs 0 ≤ NEAR < FAR in mm, got {near_mm:g} {far_mm:g}"
        raise UsageError(msg)
    if preview is not None and preview.suffix.lower() != ".png":
        msg = f"--preview writes PNG; got the name {preview.name}"
        raise UsageError(msg)
    if map_file is not None and map_file.suffix.lower() != ".npz":
        msg = f"--map writes a NumPy archive, .npz; got the name {map_file.name}"
        raise UsageError(msg)
    named = None if keys is None else CalibrationKeys.parse(keys)
    if options := pair.options():
        if (
            pair.stereo is None
            or {*(folder, projector_size, grey_noise, map_file, extrinsics)} != {None}
            or guess
        ):
            msg = (
                f"{', '.join(options)}: a stereo pair is given with --stereo LEFT RIGHT alone, "
                "without a folder before it, --projector-size, --grey-noise, --map, "
                "--extrinsics and --guess"
            )
            raise UsageError(msg)
        return decode_stereo(
            pair,
            calibration=calibration,
            sequence=sequence,
            output=output,
            preview=preview,
            depth_limits_mm=depth_limits_mm,
            despite=despite,
            limits=limits,
            keys=named,
        )
    proposed = None
    if guess and folder is not None and sequence is None:
        proposed = guessed(folder, calibration, projector_size, named, extrinsics)
        if calibration is None or (output is not None and output.suffix.lower() == ".toml"):
            return guess_result(folder, proposed, output)
    if calibration is None and map_file is not None and folder is not None and sequence is not None:
        return _map_alone(folder, sequence, output, map_file, preview, despite, limits)
    if folder is None or calibration is None or (sequence is None) == (proposed is None):
        msg = (
            "give a folder of frames with --calibration and --sequence (or --guess), with --map "
            "and --sequence, or a stereo pair with --stereo"
        )
        raise UsageError(msg)
    check_names(despite, (*FRAME_CHECKS, INTERSECTIONS))
    files = [
        Written.at(path, kind)
        for path, kind in ((output, "cloud"), (map_file, "map"), (preview, "preview"))
        if path is not None
    ]
    patterns = (
        imaging.sequence_named_or_read(sequence or "") if proposed is None else (proposed.sequence)
    )
    read_calibration_nodes(calibration)  # its faults are told before frames are read
    start = time.perf_counter()
    stack = imaging.read_recording(folder, patterns)
    rig = read_projector_camera(
        calibration,
        named,
        more=extrinsics,
        image_size=stack.image_shape[::-1],
        projector_size=projector_size,
    )
    decoded = imaging.decode(stack, patterns, limits, despite=despite)
    if preview is not None:
        _write_preview(preview, decoded)  # first: it helps to see why there are no points
    if map_file is not None:
        imaging.write_map(map_file, decoded)
    meeting = map_contradiction(decoded, rig.camera, rig.projector, rig.projector_from_camera)
    found = (*decoded.contradictions, *settle([meeting], despite))
    cloud = _triangulated(decoded, rig, depth_limits_mm)
    if not cloud.n_valid:
        raise CloudError(_why_empty(decoded, rig, depth_limits_mm, limits.min_modulation))
    seconds = time.perf_counter() - start
    cloud, of_noise = imaging.recorded_sigma_z(
        cloud,
        stack,
        patterns,
        decoded,
        projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
        grey_noise=grey_noise,
    )
    if output is not None:
        write_cloud(output, cloud)
    near, middle, far = np.percentile(cloud.valid_points[:, 2].astype(float), [0, 50, 100]).tolist()
    rows, columns = stack.image_shape
    return Result(
        title=f"{folder}: {patterns.name}",
        facts=(
            fact("sequence", patterns.name, ""),
            fact("frames", stack.n_frames),
            fact("size_px", [columns, rows], f"{columns} × {rows}, {stack.bit_depth} bits"),
            fact("points", cloud.n_valid, f"{count(cloud.n_valid)} in {seconds:.2f} s"),
            fact("seconds", seconds, ""),
            fact(
                "depth_mm",
                {"min": near, "median": middle, "max": far},
                f"{number(near)} to {number(far)} mm, median {number(middle)} mm",
            ),
            *_sigma_fact(cloud),
        ),
        tables=(
            *(() if proposed is None else (guess_table(proposed),)),
            _pixel_table(decoded.counts()),
        ),
        contradictions=found,
        notes=(
            *filter(None, (of_noise,)),
            *(() if files else ("nothing was written: --output keeps the cloud",)),
        ),
        files=tuple(files),
    )


def _map_alone(
    folder: Path,
    sequence: str,
    output: Path | None,
    map_file: Path,
    preview: Path | None,
    despite: tuple[str, ...],
    limits: imaging.DecodingLimits,
) -> Result:
    """Decode to a map where there is no calibration."""
    if output is not None:
        msg = (
            "--output needs --calibration: without camera and projector there are no points, only "
            "the map"
        )
        raise UsageError(msg)
    check_names(despite, FRAME_CHECKS)
    patterns = imaging.sequence_named_or_read(sequence)
    files = [Written.at(map_file, "map")]
    stack = imaging.read_recording(folder, patterns)
    decoded = imaging.decode(stack, patterns, limits, despite=despite)
    if preview is not None:
        files.append(Written.at(preview, "preview"))
        _write_preview(preview, decoded)
    counts = decoded.counts()
    if not counts.decoded:
        raise CloudError(_why_not_decoded(decoded, limits.min_modulation))
    imaging.write_map(map_file, decoded)
    rows, columns = stack.image_shape
    return Result(
        title=f"{folder}: {patterns.name}",
        facts=(
            fact("sequence", patterns.name, ""),
            fact("frames", stack.n_frames),
            fact("size_px", [columns, rows], f"{columns} × {rows}, {stack.bit_depth} bits"),
            fact("decoded", counts.decoded, f"{count(counts.decoded)} pixels"),
        ),
        tables=(_pixel_table(counts),),
        contradictions=decoded.contradictions,
        files=tuple(files),
    )


def _sigma_fact(cloud: Cloud) -> tuple[Fact, ...]:
    """Return the median standard deviation of the points, where it is known."""
    if cloud.sigma_z_mm is None:
        return ()
    median = float(np.median(cloud.sigma_z_mm[cloud.valid]))
    text = f"{number(median)} mm, median standard deviation of a point's depth"
    return (fact("sigma_z_mm", median, text),)


def _triangulated(
    decoded: imaging.DecodedMap, rig: ProjectorCamera, depth_limits_mm: tuple[float, float]
) -> Cloud:
    return imaging.triangulate(
        decoded,
        camera=rig.camera,
        projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
        depth_limits_mm=depth_limits_mm,
    )


def _pixel_table(counts: imaging.DecodingCounts) -> Table:
    """Return how many pixels were decoded, and why the others were not."""
    numbers = asdict(counts)
    return Table.of(
        "pixels",
        (
            {
                "pixels": name.replace("_", " "),
                "count": numbers[name],
                "share": numbers[name] / counts.pixels,
                "meaning": meaning,
            }
            for name, meaning in _MEANINGS.items()
        ),
        (
            Column(name="pixels"),
            Column(name="count"),
            Column(name="share", label="share %", scale=100, decimals=1),
            Column(name="meaning", wraps=True),
        ),
    )


def _why_empty(
    decoded: imaging.DecodedMap,
    rig: ProjectorCamera,
    depth_limits_mm: tuple[float, float],
    min_modulation: float,
) -> str:
    """Return why a cloud has no point: depth limits, light, or the calibration."""
    anywhere = _triangulated(decoded, rig, (0.0, np.inf))
    near_mm, far_mm = depth_limits_mm
    if anywhere.n_valid:
        depth_mm = anywhere.valid_points[:, 2]
        nearer = int(np.count_nonzero(depth_mm <= near_mm))
        return (
            f"no point lies within --depth-limits {near_mm:g} {far_mm:g} mm: {count(nearer)} are "
            f"nearer and {count(anywhere.n_valid - nearer)} farther, from "
            f"{number(float(depth_mm.min()))} to {number(float(depth_mm.max()))} mm; set the "
            "limits, in mm, around these"
        )
    counts = decoded.counts()
    if counts.decoded:
        return (
            f"no point: {count(counts.decoded)} pixels were decoded, but none of their rays meets "
            "the projector's light; check that the calibration is of this camera and projector"
        )
    return _why_not_decoded(decoded, min_modulation)


def _why_not_decoded(decoded: imaging.DecodedMap, min_modulation: float) -> str:
    counts = decoded.counts()
    return (
        f"no point: none of {count(counts.pixels)} pixels was decoded; the patterns' amplitude "
        f"reaches {number(float(decoded.modulation.max()))} grey levels, --min-modulation asks for "
        f"{number(min_modulation)}, and {count(counts.clipped)} pixels are clipped; check the "
        "sequence and the exposure time"
    )


def _write_preview(path: Path, decoded: imaging.DecodedMap) -> None:
    """Write coordinate and modulation side by side as a PNG."""
    axes = ((decoded.column, decoded.projector_width), (decoded.row, decoded.projector_height))
    share = next(coordinate / size for coordinate, size in axes if coordinate is not None)
    grey: NDArray[np.uint8] = (255.0 * np.nan_to_num(share)).clip(0, 255).astype(np.uint8)
    coloured = cv2.applyColorMap(grey, cv2.COLORMAP_TURBO)
    coloured[~decoded.valid] = 0
    strongest = max(float(decoded.modulation.max()), 1.0)
    modulation = (255.0 * decoded.modulation / strongest).astype(np.uint8)
    picture = np.hstack([coloured, cv2.cvtColor(modulation, cv2.COLOR_GRAY2BGR)])
    _, png = cv2.imencode(".png", picture)
    write_durably(path, png.tobytes())
