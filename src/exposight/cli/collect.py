"""``exposight collect``: a folder of images and clouds to a campaign."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import polars as pl
from cyclopts import Group, Parameter

from exposight import cell
from exposight.cli.app import UsageError
from exposight.cli.capture_options import CaptureOptions
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.errors import FormatError, PoseError
from exposight.files import recognised, spelled
from exposight.geometry import (
    RigidTransform,
    camera_from_part_of,
    check_length_unit,
    other_chains,
    read_named_poses,
    read_pose,
)
from exposight.measuring import Collected, CollectSettings, collect, read_capture_table
from exposight.tables import Column, Table

_SHOWN = 10


@Parameter("*", group=Group("Poses of the views", sort_key=2))
@dataclass(frozen=True, kw_only=True)
class ViewPoses:
    """Where the part stood in each view.

    Parameters
    ----------
    poses
        One pose a view by its name: a table (any dialect), a robot's program, a document, a folder
        with a file for each view, or such files by their name: poses/{view}.txt. They are the
        part's in the camera's frame, or the flange's with --hand-eye.
    notation
        Of numbers without letters: fanuc, kuka, ur, … as --robot-pose has them.
    hand_eye
        The camera's pose on the flange (hand–eye calibration), a file: the poses are the robot's.
    part_pose
        With it the part's pose in the robot's base, a file.
    """

    poses: str | None = None
    notation: str | None = None
    hand_eye: Path | None = None
    part_pose: Annotated[Path | None, Parameter(alias="--part-in-base")] = None

    def read(
        self,
    ) -> tuple[
        dict[str, RigidTransform], Callable[[str], Iterable[tuple[str, RigidTransform]]] | None
    ]:
        """Return camera_from_part of each view, and other readings of each where a chain gave it.

        Raises
        ------
        UsageError
            If the chain is incomplete.
        ExposightError
            If a file cannot be used.
        """
        if (self.hand_eye is None) != (self.part_pose is None):
            msg = "a robot's poses need both --hand-eye and --part-pose"
            raise UsageError(msg)
        if self.poses is None:
            if self.hand_eye is not None:
                msg = "--hand-eye goes with --poses, the flange's in each view"
                raise UsageError(msg)
            return {}, None
        poses = (
            _by_pattern(self.poses, self.notation)
            if "{view}" in self.poses
            else read_named_poses(Path(self.poses), self.notation)
        )
        if self.hand_eye is None or self.part_pose is None:
            return poses, None
        flange_from_camera, base_from_part = read_pose(self.hand_eye), read_pose(self.part_pose)
        check_length_unit(flange_from_camera, self.hand_eye, "the hand–eye calibration")
        links = {
            name: {
                "base_from_flange": pose,
                "flange_from_camera": flange_from_camera,
                "base_from_part": base_from_part,
            }
            for name, pose in poses.items()
        }
        through = {name: camera_from_part_of(**each) for name, each in links.items()}
        return through, lambda name: other_chains(camera_from_part_of, links[name])


def _by_pattern(pattern: str, notation: str | None) -> dict[str, RigidTransform]:
    """Return the poses of files such as ``poses/{view}.txt``."""
    path = Path(pattern)
    before, _, after = path.name.partition("{view}")
    files = sorted(path.parent.glob(f"{before}*{after}"))
    if not files:
        msg = f"{pattern}: no such file for any view"
        raise PoseError(msg)
    end = len(after)
    return {
        file.name[len(before) : len(file.name) - end]: read_pose(file, notation) for file in files
    }


_NO_POSES, _USUAL = ViewPoses(), CaptureOptions()


def collect_command(
    folder: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")],
    features: Path,
    sensor: Annotated[str, Parameter(metavar="NAME|FILE")],
    name: Annotated[str | None, Parameter(metavar="PATTERN")] = None,
    cloud_name: Annotated[str | None, Parameter(metavar="PATTERN")] = None,
    table: Path | None = None,
    part_name: str | None = None,
    despite: tuple[str, ...] = (),
    views: ViewPoses = _NO_POSES,
    files: Annotated[
        CaptureOptions, Parameter("*", group=Group("Images and clouds", sort_key=3))
    ] = _USUAL,
) -> Result:
    r"""Collect a folder of images and clouds into a campaign.

    Each image and its cloud, as a scanner wrote them, become a capture; view and exposure time are
    told by their names, by the images' EXIF or by a table. What is in the campaign already is kept,
    so that the same command goes on after an interruption, or with new files. Files that cannot be
    used are named at the end, and the others are taken (exit status 1).

    For example:

        exposight collect scans --name "P{view}_{exposure}ms" --features holes.csv \
          --sensor sensor.json --poses poses.csv -o door

        exposight collect scans --name "{view}/{exposure}us/*" --features holes.csv \
          --sensor sensor.json --poses DOOR.LS --hand-eye hand_eye.txt --part-pose part.txt \
          -o door

    Parameters
    ----------
    folder
        Folder with images and clouds, also in its sub-folders.
    output
        The campaign's folder; made, or gone on with.
    features
        The part's features (docs/formats.md).
    sensor
        Name of a preset (comet-pro-ae, rc-visard-65) or JSON file of a sensor.
    name
        How images are named, without their suffix: P{view}_{exposure}ms, {view}/{exposure}us/*.
        {exposure:f} may have its decimals behind an underscore, {exposure:d} is a whole number, {}
        and * are what does not matter. Recognised where it is left out.
    cloud_name
        How clouds are named, if otherwise than their images.
    table
        Table with a column file or view, with exposure times and perhaps poses.
    part_name
        Name of the part; that of the list of features by default.
    despite
        Go on although this check found a contradiction (docs/contradictions.md); may be repeated.
    """
    found = cell.find_recordings(folder, name=name, cloud_name=cloud_name)
    part = cell.Part(
        name=part_name or spelled(features.stem), features=cell.read_features(features)
    )
    poses, other_poses = views.read()
    settings = CollectSettings(
        sensor=cell.sensor_named_or_read(sensor),
        part=part,
        poses=poses,
        other_poses=other_poses,
        form=files.form,
        table=None if table is None else read_capture_table(table),
        despite=despite,
    )
    if not settings.poses and not (settings.table and settings.table.poses):
        msg = "give the views' poses by --poses, or in a --table"
        raise UsageError(msg)
    written = Written.at(output, "campaign")
    with progress_bars(kept_in=output) as progress:
        collected = collect(found, output, settings, progress)
    recognised(folder, *collected.remarks)
    return _result(collected, part, written)


def _result(collected: Collected, part: cell.Part, written: Written) -> Result:
    keys = (*collected.kept, *collected.taken)
    views = list(dict.fromkeys(key.view for key in keys))
    times = sorted({key.exposure_ms for key in keys})
    left = collected.left_out
    shown = left_out_lines(left)
    result = Result(
        title=f"{len(keys)} captures of {part.name}",
        facts=(
            fact("captures", len(keys)),
            fact("new", len(collected.taken)),
            fact("views", len(views)),
            fact("exposures_ms", times, ", ".join(f"{time:g}" for time in times)),
            fact("left_out", left, str(len(left)) if left else ""),
            fact("models_need", str(collected.needs)),
            fact("more_captures", collected.needs.captures),
        ),
        tables=(_grid(keys, views, times),) if keys else (),
        notes=tuple(f"left out: {each}" for each in shown),
        contradictions=collected.contradictions,
        files=(written,),
        next_step=f"observe {written.path}",
        failed=bool(left) or not collected.needs.any_measured,
    )
    if not keys:
        msg = "; ".join(shown) or "no capture could be taken"
        raise FormatError(msg)
    return result


def left_out_lines(left: Mapping[str, str]) -> list[str]:
    """Return why files were left out, one line a reason; the first ten of them.

    Reasons that differ by the file's own name and by numbers alone are one.
    """
    alike: dict[str, list[str]] = {}
    for file, why in left.items():
        own = re.escape(Path(file).with_suffix("").name)
        key = re.sub(r"\d+([.,]\d+)?", "0", re.sub(rf"\S*{own}\S*", "", why))
        alike.setdefault(re.sub(r"\S*/\S*", "", key), []).append(file)
    lines = []
    for files in list(alike.values())[:_SHOWN]:
        more = f" (and {len(files) - 1} more like it, up to {files[-1]})" if len(files) > 1 else ""
        lines.append(f"{files[0]}: {left[files[0]]}{more}")
    if len(alike) > _SHOWN:
        lines.append(f"and {sum(map(len, list(alike.values())[_SHOWN:]))} more files")
    return lines


def _grid(keys: tuple[cell.CaptureKey, ...], views: list[str], times: list[float]) -> Table:
    """Return which view was taken at which exposure times."""
    there = set(keys)
    rows = {
        "view": views,
        "captures": [sum(cell.CaptureKey(view, t) in there for t in times) for view in views],
        "exposures_ms": [
            " ".join(f"{t:g}" for t in times if cell.CaptureKey(view, t) in there) for view in views
        ],
    }
    columns = (
        Column(name="view"),
        Column(name="captures"),
        Column(name="exposures_ms", label="at ms", wraps=True),
    )
    return Table(name="by_view", frame=pl.DataFrame(rows), columns=columns)
