"""Files under names that mean something elsewhere: patterns, options, homes, bytes that no text is.

What is written under such a name is read back under it, and files beside it whose names the name
would stand for as a pattern stay as they are.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from benchmarks.hostile_sizes import large_table

from exposight.cell import (
    CampaignFolder,
    CampaignWriter,
    Cloud,
    Feature,
    Part,
    read_cloud,
    read_features,
    read_sensor,
    sensor_preset,
    write_cloud,
    write_sensor,
)
from exposight.cell.cloud_formats.depth_images import read_depth
from exposight.cell.feature_lists.feature_files import write_features
from exposight.files import write_durably
from exposight.geometry import RigidTransform, read_calibration, read_pose
from exposight.geometry.meshes.triangle_meshes import read_mesh
from exposight.models import MODEL_SUFFIX, Training, load_model, model_named, save_model
from exposight.observing import Observation, ObservationTable, read_observations
from exposight.plans import plan_preset, read_plan, write_plan

NAMES = (
    "obs[1]", "q?", "*", "[!a]", "{a,b}", "~", "~root", "$HOME", "%s%n", "50%", "a#2", "a;b", "a&b",
    "-o", "--help", "a b", " a", "a'b", 'a"b', "a\nb", "a\tb", "a\\b", "ä", "a\u0308", "漢字", "😀",
    "a:b", "con", ".hidden", "a..b", "file:a", "http:", "\udcff\udc80", "=1+1",
)  # fmt: skip
DECOYS = ("obs1", "qa", "a", "b", "o", "help", "1")
_LONGEST = 255


@dataclass(frozen=True)
class Kind:
    """A kind of file: its suffix, values that are written, and how.

    Parameters
    ----------
    suffix : str
    values : (object, object)
        What is written under the strange name, and into the files beside it.
    write : callable
        Takes the path and a value.
    read : callable
        Takes the path; returns what can be compared with what `seen` gives of a value.
    """

    suffix: str
    values: tuple[Any, Any]
    write: Callable[[Path, Any], object]
    read: Callable[[Path], Any]
    seen: Callable[[Any], Any] = lambda value: value


def _table(feature: str) -> ObservationTable:
    row = Observation(
        feature=feature, view="v", exposure_ms=10.0, p_norm=0.5, i_avg=80.0, x_mm=1.0, y_mm=2.0,
        z_mm=600.0, w_deg=0.0, p_deg=1.0, r_deg=0.0, radius_mm=5.0,
    )  # fmt: skip
    return ObservationTable.from_observations([row])


def _feature(name: str) -> Feature:
    return Feature(name=name, kind="hole", part_from_feature=RigidTransform(), radius_mm=5.0)


def _cloud(z_mm: float) -> Cloud:
    points = np.array([[0.0, 0.0, z_mm], [1.0, 2.0, z_mm]], dtype=np.float32)
    return Cloud(points=points)


def _matrix(x_mm: float) -> str:
    return f"1 0 0 {x_mm}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"


def _camera(focal: float) -> str:
    return (
        f"image_width: 640\nimage_height: 480\ncamera_matrix: [[{focal}, 0, 320], [0, {focal}, "
        "240], [0, 0, 1]]\ndistortion_coefficients: [0, 0, 0, 0, 0]\n"
    )


def _triangle(size: float) -> bytes:
    """Return a triangle as a binary STL."""
    corners = np.array([[0, 0, 1], [0, 0, 0], [size, 0, 0], [0, size, 0]], dtype="<f4")
    return bytes(80) + (1).to_bytes(4, "little") + corners.tobytes() + bytes(2)


def _png(grey: float) -> bytes:
    image = np.full((6, 8), grey, dtype=np.uint16)
    return bytes(cv2.imencode(".png", image)[1])


def _text(path: Path, text: str) -> None:
    write_durably(path, text.encode())


def _kinds() -> Mapping[str, Kind]:
    tables = (_table("right"), _table("decoy"))
    clouds = (_cloud(500.0), _cloud(700.0))
    sensors = (sensor_preset("rc-visard-65"), sensor_preset("comet-pro-ae"))

    def named(table: ObservationTable) -> list[str]:
        return list(table.names("feature"))

    def depth(cloud: Cloud) -> float:
        return float(np.asarray(cloud.points)[..., 2].max())

    kinds = {
        f"observations {suffix}": Kind(
            suffix, tables, lambda path, table: table.write(path), read_observations, named
        )
        for suffix in (".csv", ".parquet")
    }
    kinds |= {
        f"cloud {suffix}": Kind(
            suffix, clouds, lambda path, cloud: write_cloud(path, cloud), read_cloud, depth
        )
        for suffix in (".ply", ".pcd", ".xyz", ".csv", ".npy")
    }
    kinds["features"] = Kind(
        ".csv",
        ((_feature("right"),), (_feature("decoy"),)),
        write_features,
        read_features,
        lambda features: [each.name for each in features],
    )
    kinds["sensor"] = Kind(".json", sensors, write_sensor, read_sensor, lambda each: each.name)
    kinds["plan"] = Kind(
        ".toml",
        (plan_preset("small"), plan_preset("demo")),
        write_plan,
        read_plan,
        lambda plan: plan.name,
    )
    kinds["pose"] = Kind(
        ".txt",
        (_matrix(5.0), _matrix(7.0)),
        _text,
        read_pose,
        lambda pose: pose if isinstance(pose, str) else _matrix(float(pose.translation_mm[0])),
    )
    kinds["calibration"] = Kind(
        ".yaml",
        (_camera(600.0), _camera(900.0)),
        _text,
        read_calibration,
        lambda found: found if isinstance(found, str) else _camera(found.camera.fx),
    )
    kinds["mesh"] = Kind(
        ".stl",
        (5.0, 7.0),
        lambda path, size: write_durably(path, _triangle(size)),
        lambda path: float(read_mesh(path, "mm").vertices.max()),
    )
    kinds["image"] = Kind(
        ".png",
        (500.0, 700.0),
        lambda path, grey: write_durably(path, _png(grey)),
        lambda path: float(read_depth(path).max()),
    )
    models = [
        Training(specification=model_named(name), table=large_table(60), seed=1, restarts=1).run()
        for name in ("q_k1", "q_k3")
    ]
    kinds["model"] = Kind(
        MODEL_SUFFIX, (models[0], models[1]), save_model, load_model, lambda model: model.name
    )
    return kinds


def names_of(suffix: str) -> list[str]:
    """Return the names to try, with a suffix; the last ones are as long as names may be."""
    long = ["x" * (_LONGEST - len(suffix)), "ä" * ((_LONGEST - len(suffix)) // 2)]
    return [f"{name}{suffix}" for name in (*NAMES, *long)]


def fault_of(kind: Kind, name: str, folder: Path) -> str:
    """Return what is wrong with a file of a kind under a name, written into an empty folder."""
    right, decoy = kind.values
    for beside in DECOYS:
        kind.write(folder / f"{beside}{kind.suffix}", decoy)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    path = folder / name
    kind.write(path, right)
    if kind.seen(kind.read(path)) != kind.seen(right):
        return "read back it is another"
    expected = {*before, path}
    if set(folder.iterdir()) != expected:
        return "there are other files than were written"
    changed = [each.name for each, data in before.items() if each.read_bytes() != data]
    return f"{changed} beside it changed" if changed else ""


def campaign_faults() -> list[str]:
    """Return what is wrong with campaigns in folders of strange names."""
    faults = []
    sensor = sensor_preset("rc-visard-65")
    for name in (*NAMES, "x" * _LONGEST):
        with tempfile.TemporaryDirectory() as folder:
            for place, part in (("obs1", "decoy"), ("a", "decoy"), (name, "right")):
                described = Part(name=part, features=(_feature("f"),))
                with CampaignWriter.open_or_create(
                    Path(folder) / place, name="c", sensor=sensor, part=described
                ):
                    pass
            read = CampaignFolder(Path(folder) / name).part.name
        if read != "right":
            faults.append(f"campaign {name[:40]!a}: read back it is {read}")
    return faults


def strange_names_right() -> list[str]:
    """Return what is wrong with files under strange names; nothing where all is right."""
    faults = campaign_faults()
    for what, kind in _kinds().items():
        # A process of its own for each of these would take minutes.
        names = names_of(kind.suffix)
        few = names if kind.suffix != ".parquet" else [*names[:3], names[-1]]
        for name in few:
            with tempfile.TemporaryDirectory() as folder:
                try:
                    fault = fault_of(kind, name, Path(folder))
                except Exception as error:
                    fault = f"{type(error).__name__}: {ascii(str(error))[:300]}"
            if fault:
                faults.append(f"{what} {name[:40]!a}: {fault}")
    return faults
