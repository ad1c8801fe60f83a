"""``exposight decode``: frames to an organised cloud."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import cv2
import numpy as np
import typer

from exposight.cell import CLOUD_SUFFIXES, write_cloud
from exposight.cli.output import (
    JsonOption,
    count,
    note,
    number,
    percent,
    print_facts,
    print_json,
    print_line,
    print_table,
)
from exposight.errors import CloudError
from exposight.files.durable import write_durably
from exposight.geometry import read_projector_camera
from exposight.imaging import (
    SEQUENCE_PRESETS,
    DecodingLimits,
    decode,
    read_recording,
    sequence_named_or_read,
    triangulate,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.geometry import ProjectorCamera
    from exposight.imaging import DecodedMap, FrameStack

_MEANINGS = {
    "decoded": "every coded axis was read",
    "low_modulation": "unlit, or too dark",
    "clipped": "a sample at full scale",
    "ambiguous": "bits or phases disagree",
    "outside": "no place on the projector",
}


_Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of recorded frames.")]
_Calibration = Annotated[
    Path,
    typer.Option(
        "--calibration",
        "-c",
        metavar="FILE",
        help="Camera, projector and the pose between them: OpenCV YAML or XML, named as by "
        "SLStudio or procam-calibration.",
    ),
]
_Sequence = Annotated[
    str,
    typer.Option(
        "--sequence",
        "-s",
        metavar="NAME|FILE",
        help=f"What each frame shows: {', '.join(SEQUENCE_PRESETS)}, or a TOML file.",
    ),
]
_Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help=f"Where to write the cloud: {' '.join(CLOUD_SUFFIXES)}.",
    ),
]
_ProjectorSize = Annotated[
    tuple[int, int] | None,
    typer.Option(metavar="W H", help="Projector's width and height, px, where FILE has none."),
]
_DepthLimits = Annotated[
    tuple[float, float],
    typer.Option(
        "--depth-limits", metavar="NEAR FAR", help="Leave out nearer and farther points, mm."
    ),
]
_MinModulation = Annotated[
    float,
    typer.Option(metavar="GREY", help="Least amplitude of the patterns, grey levels 0 to 255."),
]
_MIN_MODULATION = DecodingLimits().min_modulation
_Preview = Annotated[
    Path | None,
    typer.Option(metavar="PNG", help="Picture of the decoded coordinate and the modulation."),
]


def decode_command(
    folder: _Folder,
    calibration: _Calibration,
    sequence: _Sequence,
    output: _Output = None,
    projector_size: _ProjectorSize = None,
    depth_limits_mm: _DepthLimits = (0.0, np.inf),
    min_modulation: _MinModulation = _MIN_MODULATION,
    preview: _Preview = None,
    as_json: JsonOption = False,
) -> None:
    """Decode recorded stripe frames to an organised point cloud.

    Each camera pixel is told its projector column (and row, where coded) by
    Gray code or phase shift, and its ray is met with that column. The cloud is
    in mm in the camera's frame and keeps the image's rows and columns.

    For example:

      exposight decode scan1/ -c calibration.xml -s skull_2x3 -o cloud.ply
    """
    if preview is not None and preview.suffix.lower() != ".png":
        msg = f"--preview writes PNG; got the name {preview.name}"
        raise typer.BadParameter(msg)
    near_mm, far_mm = depth_limits_mm
    if not 0 <= near_mm < far_mm:
        msg = f"expected 0 ≤ NEAR < FAR in mm, got {near_mm:g} {far_mm:g}"
        raise typer.BadParameter(msg, param_hint="--depth-limits")
    limits = DecodingLimits(min_modulation=min_modulation)
    patterns = sequence_named_or_read(sequence)
    rig = read_projector_camera(calibration, projector_size=projector_size)
    start = time.perf_counter()
    stack = read_recording(folder, patterns)
    decoded = decode(stack, patterns, limits)
    if preview is not None:
        _write_preview(preview, decoded)  # first: it helps to see why there are no points
    cloud = triangulate(
        decoded,
        camera=rig.camera,
        projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
        depth_limits_mm=depth_limits_mm,
    )
    if not cloud.n_valid:
        if not as_json:
            _print_counts(asdict(decoded.counts()))
        raise CloudError(_why_empty(decoded, rig, depth_limits_mm, min_modulation))
    depth_mm = cloud.valid_points[:, 2].astype(np.float64)
    seconds = time.perf_counter() - start
    if output is not None:
        write_cloud(output, cloud)
    nearest_mm, middle_mm, farthest_mm = np.percentile(depth_mm, [0, 50, 100]).tolist()
    done = _Decoded(
        folder=folder,
        sequence=patterns.name,
        stack=stack,
        counts=asdict(decoded.counts()),
        points=cloud.n_valid,
        depth_mm={"min": nearest_mm, "median": middle_mm, "max": farthest_mm},
        seconds=seconds,
        written={"cloud": output, "preview": preview},
    )
    if as_json:
        print_json(_document(done))
    else:
        _print(done)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Decoded:
    """A recording that was decoded, and what became of it."""

    folder: Path
    sequence: str
    stack: FrameStack
    counts: dict[str, int]
    points: int
    depth_mm: dict[str, float]
    seconds: float
    written: dict[str, Path | None]


def _document(done: _Decoded) -> dict[str, object]:
    rows, columns = done.stack.image_shape
    return {
        "folder": done.folder,
        "sequence": done.sequence,
        "frames": done.stack.n_frames,
        "rows": rows,
        "columns": columns,
        "counts": done.counts,
        "points": done.points,
        "depth_mm": done.depth_mm,
        "seconds": done.seconds,
        **done.written,
    }


def _print(done: _Decoded) -> None:
    rows, columns = done.stack.image_shape
    near, middle, far = map(number, done.depth_mm.values())
    frames = f"{done.stack.n_frames} of {columns} × {rows} px, {done.stack.bit_depth} bits"
    print_facts(
        f"{done.folder}: {done.sequence}",
        [
            ("frames", frames),
            ("points", f"{count(done.points)} in {done.seconds:.2f} s"),
            ("depth", f"{near} to {far} mm, median {middle} mm"),
        ],
    )
    print_line("")
    _print_counts(done.counts)
    for what, path in done.written.items():
        if path is not None:
            print_line(f"wrote the {what}: {path}")
    if not any(done.written.values()):
        note("nothing was written: --output keeps the cloud, --preview a picture")


def _print_counts(counts: dict[str, int]) -> None:
    print_table(
        ("pixels that are", "count", "share %", "meaning"),
        (
            (
                name.replace("_", " "),
                count(counts[name]),
                percent(counts[name] / counts["pixels"]),
                meaning,
            )
            for name, meaning in _MEANINGS.items()
        ),
        words=("meaning",),
    )


def _why_empty(
    decoded: DecodedMap,
    rig: ProjectorCamera,
    depth_limits_mm: tuple[float, float],
    min_modulation: float,
) -> str:
    """Say why a cloud has no point: depth limits, light, or the calibration."""
    anywhere = triangulate(
        decoded,
        camera=rig.camera,
        projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
    )
    near_mm, far_mm = depth_limits_mm
    if anywhere.n_valid:
        depth_mm = anywhere.valid_points[:, 2]
        nearer = int(np.count_nonzero(depth_mm <= near_mm))
        return (
            f"no point lies within --depth-limits {near_mm:g} {far_mm:g} mm: {count(nearer)} are "
            f"nearer and {count(anywhere.n_valid - nearer)} farther; they reach from "
            f"{number(float(depth_mm.min()))} to {number(float(depth_mm.max()))} mm: set the "
            "limits, in mm, about these"
        )
    counts = decoded.counts()
    if counts.decoded:
        return (
            f"no point: {count(counts.decoded)} pixels were decoded, but none of their rays meets "
            "the projector's light; check that the calibration is of this camera and projector"
        )
    return (
        f"no point: none of {count(counts.pixels)} pixels was decoded; the patterns' amplitude "
        f"reaches {number(float(decoded.modulation.max()))} grey levels where --min-modulation "
        f"asks for {number(min_modulation)}, and {count(counts.clipped)} pixels are clipped; check "
        "the sequence and the exposure time"
    )


def _write_preview(path: Path, decoded: DecodedMap) -> None:
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
