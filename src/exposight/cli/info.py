"""``exposight info``: what a file or folder is, told by its name and content."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exposight import cell
from exposight.cell import PRESETS, CampaignFolder
from exposight.cell.cloud_formats.cloud_files import READ_SUFFIXES
from exposight.cell.image_files import decoded_image
from exposight.cli.measure import plan_from, plan_summary
from exposight.cli.model_facts import hyperparameter_table, left_out_table, model_facts
from exposight.cli.result import Fact, Result, fact
from exposight.cli.sensor import camera_facts, sensor_facts
from exposight.cli.terminal import progress_bars
from exposight.errors import (
    AmbiguousError,
    ExposightError,
    FormatError,
    MissingFileError,
    did_you_mean,
)
from exposight.files import read_bytes
from exposight.geometry import (
    RigidTransform,
    read_calibration,
    read_calibration_nodes,
    read_named_poses,
    read_pose,
)
from exposight.geometry.calibrations.camera_info import camera_info, camera_infos
from exposight.geometry.meshes.triangle_meshes import MESH_SUFFIXES, PART_SUFFIXES, read_part_mesh
from exposight.imaging import SEQUENCE_PRESETS, read_map, read_sequence
from exposight.measuring import read_state, recorded_driver
from exposight.models import (
    MODEL_SUFFIX,
    GaussianProcessModel,
    RadianceModel,
    WindowModel,
    is_model_file,
    load_model,
)
from exposight.observing import read_observations
from exposight.planning import read_exposure_plan
from exposight.plans import PLAN_FORMAT, PLAN_SUFFIXES, PLANS
from exposight.quantities import quantity
from exposight.tables import Table, count, number
from exposight.twin.part import SCENE_FILE, is_scene, read_scene, scene_sensor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    Matches = Callable[[Path], bool]
    Describe = Callable[[Path], Iterable[Fact]]

_IMAGES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".pgm")
_CLOUDS = tuple(suffix for suffix in READ_SUFFIXES if suffix != ".csv")
_CALIBRATIONS = (".xml", ".yml", ".yaml", ".json", ".ini", ".conf", ".mat")
_MATRIX = 9
"""Numbers of a camera matrix; a file without an array as large is no calibration."""
_PROGRAMS = (".ls", ".src", ".mod", ".modx", ".script", ".urscript")
_COLUMNS = ("exposure_ms", "p_norm", "i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")


KINDS: list[tuple[str, str, Matches, Describe]] = []
"""Name, what it is known by, whether a path is one, its facts; the first that matches counts."""


def _kind(name: str, known_by: str, matches: Matches) -> Callable[[Describe], Describe]:
    """Register the function that reads a kind of file and yields the facts worth knowing."""

    def register(describe: Describe) -> Describe:
        KINDS.append((name, known_by, matches, describe))
        return describe

    return register


def info_command(file: Path, /) -> Result:
    """Identify a file or folder and summarise its content.

    Campaigns and models are verified against their checksums.

    For example:

        exposight info models/quality.exposight-model

        exposight info small

    Parameters
    ----------
    file
        Campaign, model, sensor, feature list, observation table, point cloud, image, folder of
        frames, calibration, pattern sequence, decoded map, measuring plan, exposure plan or state
        of a loop; or the name of a plan or sensor.
    """
    if not file.exists() and str(file) not in (names := (*PLANS, *PRESETS)):
        msg = f"{file}: no such file or folder, nor a plan or sensor of that name"
        raise MissingFileError(msg + did_you_mean(str(file), names))
    if file.exists() and not (file.is_file() or file.is_dir()):
        msg = f"{file}: a device, a pipe or the like; expected a file or a folder"
        raise FormatError(msg)
    for kind, _, matches, describe in KINDS:
        if matches(file):
            facts = (fact("path", str(file), ""), fact("kind", kind, ""), *describe(file))
            tables, notes = _model_tables(file) if kind == "model" else ((), ())
            return Result(title=f"{file}: {kind}", facts=facts, tables=tables, notes=notes)
    known = ", ".join(f"{kind} ({known_by})" for kind, known_by, _, _ in KINDS)
    msg = f"{file}: not something that exposight knows; it knows {known}"
    raise FormatError(msg)


def _facts(**values: object) -> Iterator[Fact]:
    """Return facts whose texts are their values."""
    return (fact(name, value) for name, value in values.items())


def _range(name: str, values: Iterable[float]) -> Fact:
    """Return the smallest and largest finite value of a quantity."""
    finite = [float(value) for value in values if np.isfinite(value)]
    if not finite:
        return fact(name, None)
    low, high = min(finite), max(finite)
    text = f"{number(low)} to {number(high)} {quantity(name).suffix}".rstrip()
    return fact(name, [low, high], text)


def _names(name: str, names: Sequence[str]) -> Fact:
    """Return how many names there are, and the first few."""
    first = ", ".join(names[:5]) + (" …" if len(names) > 5 else "")
    return fact(name, list(names), f"{len(names)}: {first}" if names else "none")


def _named(*suffixes: str, having: str = "") -> Matches:
    """Match files by suffix and, if given, by words of which one must be in the text."""

    def matches(path: Path) -> bool:
        if not path.is_file() or path.suffix.lower() not in suffixes:
            return False
        text = path.read_text("utf-8-sig", errors="replace") if having else ""
        return any(words in text for words in having.split("|"))

    return matches


@_kind(
    "campaign",
    "folder with campaign.json",
    lambda path: (path / "campaign.json").is_file() or path.name == "campaign.json",
)
def _campaign(path: Path) -> Iterator[Fact]:
    folder = path if path.is_dir() else path.parent
    campaign = CampaignFolder(folder)
    keys = campaign.keys()
    emulated = clouds = 0
    with progress_bars() as progress:
        for done, capture in enumerate(campaign.captures(), start=1):  # verifies each, too
            emulated += capture.emulated
            clouds += capture.cloud is not None
            progress("verifying captures", done, len(campaign))
    yield from _facts(name=campaign.name, part=campaign.part.name, sensor=campaign.sensor.name)
    yield _names("features", [feature.name for feature in campaign.part.features])
    yield _names("views", sorted({key.view for key in keys}))
    yield fact("exposures_ms", sorted({key.exposure_ms for key in keys}))
    yield fact("captures", len(campaign), f"{len(campaign)}, every file verified")
    simulated = recorded_driver(folder) == "simulated cell"
    yield from _facts(clouds=clouds, emulated=emulated, simulated=simulated)


@_kind(
    "scene",
    f"{SCENE_FILE}, its folder, or features beside {', '.join(MESH_SUFFIXES)}",
    lambda path: _is_scene(path),
)
def _scene(path: Path) -> Iterator[Fact]:
    scene, sensor = read_scene(path), scene_sensor(path)
    yield from _facts(part=scene.part.name, triangles=len(scene.faces))
    yield _names("features", [feature.name for feature in scene.part.features])
    yield fact("sensor", sensor.name if sensor else None)


@_kind(
    "mesh of a part",
    ", ".join(PART_SUFFIXES),
    lambda path: (
        _named(*PART_SUFFIXES)(path) and (path.suffix.lower() != ".ply" or _has_faces(path))
    ),
)
def _mesh(path: Path) -> Iterator[Fact]:
    yield fact("read_by", f"exposight part {path.name} -o FOLDER")
    try:
        mesh = read_part_mesh(path)
    except AmbiguousError as error:  # its unit
        yield fact("open_question", str(error))
        return
    size = np.ptp(mesh.vertices, axis=0)
    yield fact("triangles", len(mesh.faces))
    yield fact("size_mm", size.tolist(), " × ".join(number(extent) for extent in size) + " mm")


def _has_faces(path: Path) -> bool:
    head = path.read_bytes()[:4000].partition(b"end_header")[0]
    return b"element face" in head


def _is_scene(path: Path) -> bool:
    """Tell whether a path is a scene; a mesh alone, without features beside it, is none."""
    if not is_scene(path):
        return False
    if path.suffix.lower() not in PART_SUFFIXES:
        return True
    beside = (path.with_suffix(".csv"), path.with_name("features.csv"))
    return any(each.is_file() for each in beside)


@_kind("poses", "a robot's program or a 4 × 4 matrix", lambda path: bool(_poses_of(path)))
def _poses(path: Path) -> Iterator[Fact]:
    poses = _poses_of(path)
    yield _names("poses", list(poses))
    x, y, z = next(iter(poses.values())).translation_mm
    yield fact("first_at_mm", [x, y, z], f"{number(x)}, {number(y)}, {number(z)} mm")


def _poses_of(path: Path) -> dict[str, RigidTransform]:
    """Return the poses of a robot's program, or of a text with one matrix; else none."""
    is_program = _named(*_PROGRAMS)(path)
    if not is_program and not _named(".txt", ".dat", ".tf")(path):
        return {}
    if not is_program and path.stat().st_size > 2000:
        return {}
    try:
        return read_named_poses(path) if is_program else {path.stem: read_pose(path)}
    except ExposightError:
        if is_program and path.suffix.lower() != ".dat":
            raise
        return {}


@_kind("model", MODEL_SUFFIX, lambda path: path.suffix == MODEL_SUFFIX or is_model_file(path))
def _model(path: Path) -> Iterator[Fact]:
    model = load_model(path)
    yield from _facts(model=model.name, title=model.title, target=model.target)
    for name, limits in model.training_range.items():
        yield _range(name, limits)
    sensor = model.sensor.name if model.sensor else None
    origin = asdict(model.provenance)
    yield _names("features", origin.pop("features"))
    yield from _facts(rows=model.n_observations, sensor=sensor, **origin)
    if isinstance(model, WindowModel | RadianceModel):
        yield from model_facts(model)
    if isinstance(model, GaussianProcessModel):
        yield from _facts(**asdict(model.summary))


def _model_tables(path: Path) -> tuple[tuple[Table, ...], tuple[str, ...]]:
    """Return a model's hyperparameters, how it does on what was left out, and its weak points."""
    model = load_model(path)
    tables = (hyperparameter_table(model),)
    if not isinstance(model, WindowModel | RadianceModel):
        return tables, ()
    radiance = model.radiance if isinstance(model, WindowModel) else model
    return (left_out_table(radiance), *tables), model.notes


@_kind(
    "measuring plan",
    f"{', '.join(PLAN_SUFFIXES)}, or a name from simulate --list",
    # Nothing else has exposure times in groups: reading it tells what its first line lacks.
    lambda path: (
        _named(*PLAN_SUFFIXES, having=f"{PLAN_FORMAT}|exposures_ms")(path)
        or (str(path) in PLANS and not path.exists())
    ),
)
def _plan(path: Path) -> Iterable[Fact]:
    return plan_summary(plan_from(str(path)))


@_kind("exposure plan", ".json", _named(".json", having='"exposight plan"'))
def _exposure_plan(path: Path) -> Iterable[Fact]:
    plan = read_exposure_plan(path)
    exposures = {view.name: [each.exposure_ms for each in view.exposures] for view in plan.views}
    each = (f"{name} {', '.join(map(number, times))}" for name, times in exposures.items())
    return (
        fact("answer", plan.verdict),
        fact("sensor", plan.sensor),
        fact("part", plan.part),
        _names("features", [each.feature for each in plan.features]),
        fact("exposures_ms", exposures, "\n".join(each)),
        fact("promised", plan.promise.expected_covered),
    )


@_kind("state of a loop", ".json", _named(".json", having='"exposight loop state"'))
def _loop_state(path: Path) -> Iterable[Fact]:
    state = read_state(path)
    return _facts(
        captures=len(state.captures),
        views=list(dict.fromkeys(each.view for each in state.captures)),
        models=[Path(each).name for each in state.models],
        part=state.part,
    )


@_kind(
    "sensor",
    ".json, or a preset's name",
    lambda path: str(path) in PRESETS or _named(".json", having="exposight sensor")(path),
)
def _sensor(path: Path) -> Iterable[Fact]:
    return sensor_facts(cell.sensor_named_or_read(str(path)))


@_kind("observation table", ".csv, .parquet", _named(".csv", ".parquet", having="exposure_ms"))
def _observations(path: Path) -> Iterator[Fact]:
    table = read_observations(path)
    counts = table.counts()
    yield fact("rows", len(table))
    yield _names("features", sorted(set(table.names("feature"))))
    yield _names("views", sorted(set(table.names("view"))))
    yield fact("visibility", counts, ", ".join(f"{n} {reason}" for reason, n in counts.items()))
    yield fact("emulated", int(table.frame["emulated"].sum()))
    for name in _COLUMNS:
        yield _range(name, table.measured().array([name])[:, 0])


@_kind("feature list", ".csv", _named(".csv", having="kind|nx"))
@_kind("feature list", ".dmi, .dmis, .qif", _named(".dmi", ".dmis", ".dms", ".qif"))
def _features(path: Path) -> Iterator[Fact]:
    features = cell.read_features(path)
    kinds = Counter(feature.kind for feature in features)
    yield _names("features", [feature.name for feature in features])
    yield fact("kinds", kinds, ", ".join(f"{n} {kind}" for kind, n in kinds.items()))
    yield _range("radius_mm", [feature.radius_mm for feature in features])


@_kind("feature list", ".csv in any dialect", lambda path: _is_list(path))
def _foreign_features(path: Path) -> Iterable[Fact]:
    return _features(path)


def _is_list(path: Path) -> bool:
    if not _named(".csv")(path) or _named(".csv", having="x_mm,y_mm,z_mm")(path):
        return False
    try:
        cell.read_features(path)
    except AmbiguousError:
        return True
    except ExposightError:
        return False
    return True


@_kind("point cloud", ".csv", _named(".csv", having="x_mm,y_mm,z_mm"))
@_kind("point cloud", ", ".join(_CLOUDS), _named(*_CLOUDS))
def _cloud(path: Path) -> Iterator[Fact]:
    cloud = cell.read_cloud(path)
    yield from _facts(points=cloud.n_valid, organised=cloud.organised)
    yield fact("shape", list(cloud.valid.shape))
    for axis, name in enumerate(("x_mm", "y_mm", "z_mm")):
        yield _range(name, cloud.valid_points[:, axis])
    yield fact("unit", "mm", "taken to be mm; the file does not say")


@_kind("image", ", ".join(_IMAGES), _named(*_IMAGES))
def _image(path: Path) -> Iterator[Fact]:
    image = decoded_image(read_bytes(path, "image"), path)
    bits = 8 * image.dtype.itemsize
    clipped = float(np.mean(image == 2**bits - 1))
    yield fact("size_px", [image.shape[1], image.shape[0]])
    yield from _facts(bits=bits, channels=1 if image.ndim == 2 else image.shape[2])
    yield _range("grey_levels", (image.min(), image.max()))
    yield fact("clipped_share", clipped, f"{100 * clipped:.1f} % at full scale")


@_kind(
    "folder of frames",
    "images in it",
    lambda path: path.is_dir() and any(map(_named(*_IMAGES), path.iterdir())),
)
def _frames(path: Path) -> Iterator[Fact]:
    frames = sorted(filter(_named(*_IMAGES), path.iterdir()))
    fitting = []
    for name, sequence in SEQUENCE_PRESETS.items():
        if sum(frame.match(sequence.file_pattern) for frame in frames) == sequence.n_frames:
            fitting.append(name)
    yield _names("frames", [frame.name for frame in frames])
    yield fact("fitting_sequences", fitting, ", ".join(fitting) or "none of the presets")
    yield from _image(frames[0])


@_kind("calibration", ", ".join(_CALIBRATIONS), _named(*_CALIBRATIONS))
def _calibration(path: Path) -> Iterator[Fact]:
    file = read_calibration_nodes(path)
    infos = camera_infos(file)
    if len(infos) == 1:
        info = camera_info(infos[0])
        yield fact("form", "ROS camera_info")
        yield from camera_facts("camera", info.raw)
        if info.rectified is not None:
            yield from camera_facts("rectified_camera", info.rectified)
        return
    yield fact("nodes", sorted(file.nodes), ", ".join(sorted(file.nodes)))
    try:
        found = read_calibration(path, images="raw")
    except (FormatError, AmbiguousError) as error:  # a size, or which node is what
        if not any(np.size(node) >= _MATRIX for node in file.nodes.values()):
            raise
        yield fact("open_question", str(error))
        return
    yield from camera_facts("camera", found.camera)
    for name, other in (("second_camera", found.second), ("projector", found.projector)):
        if other is not None and found.transform is not None:
            yield from camera_facts(name, other)
            yield fact("baseline_mm", float(np.linalg.norm(found.transform.translation_mm)))


@_kind("pattern sequence", ".toml", _named(".toml"))
def _sequence(path: Path) -> Iterator[Fact]:
    sequence = read_sequence(path)
    yield from _facts(name=sequence.name, frames=sequence.n_frames, bits=sequence.bit_depth)
    for axis, coding, _ in sequence.axes():
        parts = []
        if (code := coding.gray_code) is not None:
            kind = "Gray code" if code.code == "gray" else "plain binary code"
            parts.append(f"{kind} of {len(code.frames)} bits, {code.code_width:g} px a code")
        if coding.fringes:
            periods = ", ".join(f"{fringe.periods:g}" for fringe in coding.fringes)
            steps = ", ".join(str(len(fringe.frames)) for fringe in coding.fringes)
            parts.append(f"fringes of {periods} periods in {steps} steps")
        yield fact(axis, asdict(coding), "; ".join(parts))


@_kind("decoded map", ".npz", _named(".npz"))
def _map(path: Path) -> Iterator[Fact]:
    decoded = read_map(path)
    counts = decoded.counts()
    share = f"{count(counts.decoded)} of {count(counts.pixels)} pixels"
    yield fact("size_px", list(decoded.image_shape[::-1]))
    yield fact("projector_size_px", [decoded.projector_width, decoded.projector_height])
    yield fact("decoded", counts.decoded, share)
    for name in ("column", "row"):
        coordinate = getattr(decoded, name)
        if coordinate is not None:
            yield _range(f"{name}_px", coordinate.ravel())
    yield _range("modulation", decoded.modulation.ravel())
