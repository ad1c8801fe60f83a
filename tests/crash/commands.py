"""All commands that write, with inputs so small that each takes a moment.

``{in}`` stands for the folder of inputs, ``{out}`` for that of outputs.
"""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tests.conftest import HOLES, _plate, _thickened
from tests.end_to_end.conftest import plate, plate_capture, plate_sensor
from tests.end_to_end.test_reproduce import FEATURES, observation

from exposight.cell import (
    CampaignFolder,
    CampaignWriter,
    sensor_preset,
    write_cloud,
)
from exposight.geometry import RigidTransform
from exposight.imaging import AxisCoding, GrayCode, PatternSequence, sequence_to_toml
from exposight.observing import ObservationTable
from exposight.plans import DepthPlane, MeasuringPlan, PoseList, write_plan
from exposight.twin import export_scene

HEIGHTS_MM = (560.0, 600.0)
EXPOSURES_MS = (3.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command that writes.

    Parameters
    ----------
    name : str
        For tables.
    words : str
        The call.
    before : str
        Another call, whose outputs are there already; none where it is empty.
    once : bool
        It makes a folder that is not there: what it made before, it does not make again.
    most : int or None
        It takes seconds, so that so many points must do, unless all are asked for.
    """

    name: str
    words: str
    before: str = ""
    once: bool = False
    most: int | None = None


_VIEW = "--campaign {in}/plate --view z600"
_NEEDED = "--name mine --working-distance 500 1000"
_SENSOR = f"sensor --resolution 240 180 {_NEEDED} -o {{out}}/s.json --field-of-view"
_SPLIT = "split {in}/o.csv -o {out}/split --by row"
_SIMULATE = "simulate {in}/sheet.toml --scene {in}/scene --rings-only"
_REPLAY = "measure {in}/again.toml --driver replay --recording {in}/plate"
_COLLECT = (
    "collect {in}/scans --features {in}/plate/features.csv --sensor {in}/plate/sensor.json "
    "--poses {in}/poses --name {view}_{exposure}ms -o {out}/collected"
)
_NEXT = "next {out}/state.json --plan {in}/plan.json --campaign {in}/plate --models {in}/models"

_LIMITS = "[small]\nmin_ms = 0.5\nmax_ms = 50.0\nincrement_ms = 0.5\nallowed_ms = [3.0, 10.0]\n"

COMMANDS = (
    Command(
        name="sensor",
        words=f"{_SENSOR} 400 300 700 --exposures 1 100",
        before=f"{_SENSOR} 500 375 700 --exposures 1 100",
    ),
    Command(name="split", words=f"{_SPLIT} --seed 1", before=f"{_SPLIT} --seed 2"),
    Command(
        name="predict",
        words="predict {in}/models/quality.exposight-model {in}/o.csv -o {out}/p.csv",
        before="predict {in}/models/exposure.exposight-model {in}/o.csv -o {out}/p.csv",
    ),
    Command(name="observe", words="observe {in}/plate -o {out}/o.csv"),
    Command(
        name="evaluate",
        words="evaluate {in}/models/quality.exposight-model {in}/o.csv --picture {out}/e.svg",
    ),
    Command(
        name="forecast",
        words=f"forecast {{in}}/models {_VIEW} --exposures 3 10 --csv {{out}}/f.csv "
        "--picture {out}/f.png",
    ),
    Command(
        name="recommend",
        words=f"recommend {{in}}/models {_VIEW} --csv {{out}}/r.csv --picture {{out}}/r.svg",
    ),
    Command(
        name="plan",
        words="plan {in}/models --views {in}/plate -o {out}/p.json --measuring-plan {out}/p.toml "
        "--confidence 0.6",
    ),
    Command(name="measure", words=f"{_REPLAY} -o {{out}}/again"),
    Command(name="measure --no-clouds", words=f"{_REPLAY} --no-clouds -o {{out}}/again"),
    Command(name="measure --observe", words=f"{_REPLAY} --observe -o {{out}}/o.csv"),
    Command(
        name="measure, closed loop",
        words="measure {in}/plan.json --driver replay --recording {in}/plate --models {in}/models "
        "-o {out}/closed --merge {out}/merged",
        once=True,
    ),
    Command(name="next, begun", words=_NEXT),
    Command(
        name="next, a step",
        words="next {out}/state.json --capture {in}/plate/captures/000000",
        before=_NEXT,
    ),
    Command(name="collect", words=_COLLECT),
    Command(name="merge", words="merge {in}/plate -o {out}/merged", once=True),
    Command(name="part", words="part {in}/scene/sheet.ply -o {out}/part"),
    Command(
        name="decode",
        words="decode {in}/frames -s {in}/frames/sequence.toml --map {out}/map.npz",
    ),
    Command(
        name="train",
        words="train {in}/o.csv -o {out}/models --sensor {in}/plate/sensor.json --restarts 1 "
        "--workers 1",
        most=4,
    ),
    Command(
        name="train, a campaign",
        words="train {in}/plate -o {out}/models -m e_k1 --restarts 1 --workers 1",
        most=4,
    ),
    Command(
        name="propose",
        words="propose {in}/models/quality.exposight-model --views {in}/plate "
        "--next-plan {out}/next.toml",
    ),
    Command(
        name="compare",
        words="compare --sweep {in}/o.csv --strategies geometric_2 -o {out}/c --workers 1",
        most=4,
    ),
    Command(name="report", words="report {in}/plate -o {out}/page", most=4),
    Command(name="simulate", words=f"{_SIMULATE} --workers 1 -o {{out}}/sheet", most=4),
    Command(
        name="simulate --observe",
        words=f"{_SIMULATE} --workers 1 --observe -o {{out}}/o.csv",
        most=4,
    ),
    Command(
        name="simulate, two workers",
        words=f"{_SIMULATE} --workers 2 -o {{out}}/sheet",
        most=4,
    ),
    Command(
        name="simulate --export-scene",
        words="simulate {in}/sheet.toml --scene {in}/scene --export-scene {out}/scene",
    ),
    Command(
        name="reproduce",
        words="reproduce -o {out}/paper --campaigns {in}/tables --sensors structured-light "
        "--quick --workers 1",
        most=1,
    ),
)


def write_inputs(folder: Path) -> None:
    """Write what the commands read."""
    recorded = _campaign(folder / "plate")
    _call("observe", folder / "plate", "-o", folder / "o.csv")
    sensor = ("--sensor", folder / "plate" / "sensor.json")
    _call(
        "train", folder / "o.csv", "-o", folder / "models", *sensor, "--workers", 1, "--restarts", 1
    )
    poses = {each.view: each.camera_from_part for each in recorded.descriptions()}
    _scans(folder, recorded, poses)
    views = PoseList.from_transforms(
        "recorded", [*poses.values()], exposures_ms=EXPOSURES_MS, names=[*poses]
    )
    names = tuple(each.name for each in recorded.part.features if each.name != "far")
    again = MeasuringPlan(name="again", sensor=recorded.sensor, features=names, poses=[views])
    write_plan(folder / "again.toml", again)
    (folder / "limits.toml").write_text(_LIMITS, encoding="utf-8")
    words = ("--views", folder / "plate", "--confidence", 0.6, "--limits", folder / "limits.toml")
    _call("plan", folder / "models", *words, "-o", folder / "plan.json")
    write_sheet(folder)
    _frames(folder / "frames")
    (folder / "tables").mkdir()
    rows = [
        observation(number, feature, i, j, exposure_ms)
        for number, feature in enumerate(FEATURES)
        for i in (0, 1)
        for j in (-1, 0, 1)
        for exposure_ms in (6.0, 12.0, 20.0, 32.0, 50.0, 80.0)
    ]
    ObservationTable.from_observations(rows).write(folder / "tables" / "inside.csv")


def _call(*words: object) -> None:
    from exposight.cli import main

    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        status = main([str(word) for word in words])
    if status:
        raise RuntimeError(said.getvalue())


def _campaign(folder: Path) -> CampaignFolder:
    with CampaignWriter.open_or_create(
        folder, name="plate", sensor=plate_sensor(), part=plate()
    ) as writer:
        for height_mm in HEIGHTS_MM:
            for exposure_ms in EXPOSURES_MS:
                writer.add(plate_capture(height_mm, exposure_ms))
    return CampaignFolder(folder)


def _scans(folder: Path, recorded: CampaignFolder, poses: dict[str, RigidTransform]) -> None:
    """Write the campaign as a user's folder of images, clouds and poses."""
    for name in ("scans", "poses"):
        (folder / name).mkdir()
    for capture in recorded.captures():
        path = folder / "scans" / f"{capture.view}_{capture.exposure_ms:g}ms"
        cv2.imwrite(str(path.with_suffix(".png")), np.asarray(capture.image))
        write_cloud(path.with_suffix(".ply"), capture.cloud)
    for view, pose in poses.items():
        np.savetxt(folder / "poses" / f"{view}.txt", pose.to_matrix())


def write_sheet(folder: Path) -> None:
    """Write the sheet with two holes as a scene, and a plan of two views of it."""
    from tests.conftest import hole_part

    part = hole_part.__wrapped__()(HOLES) if hasattr(hole_part, "__wrapped__") else None
    sensor = sensor_preset("comet-pro-ae")
    (folder / "scene").mkdir()
    export_scene(folder / "scene", _thickened(_plate("primer", HOLES), part), sensor)
    plane = DepthPlane(
        name="middle", z_tcp_mm=-5.0, x_mm=(-60.0, 60.0), y_mm=(-30.0,), exposures_ms=(30.0, 330.0)
    )
    plan = MeasuringPlan(
        name="sheet", sensor=sensor, features=("h0", "h1"), reference="h0", planes=(plane,), seed=1
    )
    write_plan(folder / "sheet.toml", plan)


def _frames(folder: Path) -> None:
    """Write frames of seven bits, which see two camera px for each projector column."""
    sequence = PatternSequence(
        name="seven bits", projector_width=128, projector_height=96, white_frame=0, black_frame=1,
        columns=AxisCoding(gray_code=GrayCode(frames=tuple(range(2, 9)))),
    )  # fmt: skip
    folder.mkdir()
    column = np.arange(200) // 2
    for frame, lit in sequence.slides().items():
        grey = 20 + 180 * (lit.ravel()[column] if lit.size > 1 else np.full(200, lit.item()))
        cv2.imwrite(str(folder / f"frame_{frame}.png"), np.tile(grey.astype(np.uint8), (40, 1)))
    (folder / "sequence.toml").write_text(sequence_to_toml(sequence), encoding="utf-8")
