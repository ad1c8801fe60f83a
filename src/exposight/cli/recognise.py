"""What a file or folder is, told by its content and suffix, and the facts worth knowing of it."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import CLOUD_SUFFIXES, CampaignFolder, read_features, read_sensor
from exposight.cli.facts import Recognised, fact, limits, sensor_facts, short_unit, span
from exposight.cli.measuring_plans import is_plan, recognise_plan
from exposight.cli.output import count, number, progress_bars
from exposight.cli.recordings import (
    CALIBRATION_SUFFIXES,
    IMAGE_SUFFIXES,
    recognise_calibration,
    recognise_cloud,
    recognise_frames,
    recognise_image,
    recognise_sequence,
)
from exposight.errors import FormatError, MissingFileError, did_you_mean
from exposight.models import MODEL_SUFFIX, GaussianProcessModel, is_model_file, load_model
from exposight.observing import read_observations
from exposight.plans import PLAN_SUFFIXES, PLANS, read_plan
from exposight.twin.campaign import RECORD_FILE
from exposight.twin.part import MESH_FILE, read_scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from exposight.cell import Feature


_KNOWN = (
    "a campaign's folder, a model (.exposight-model), a sensor (.json), a feature list (.csv), an "
    "observation table (.csv, .parquet), a point cloud "
    f"({', '.join(CLOUD_SUFFIXES)}), an image or a folder of frames, a calibration "
    "(OpenCV .xml, .yml, .yaml; ROS camera_info), a pattern sequence (.toml), a measuring plan "
    f"({', '.join(PLAN_SUFFIXES)} or a name from simulate --list)"
)


def recognise(path: Path) -> Recognised:
    """Tell what a file or folder is, and read it.

    Parameters
    ----------
    path : Path
        The file or folder; or, where there is none, the name of a measuring plan.

    Raises
    ------
    MissingFileError
        If there is nothing of that name.
    FormatError
        If it is nothing that exposight knows; the message lists what it knows.
    ExposightError
        If it is damaged, or not what it looks like.
    """
    if path.is_dir():
        return _folder(path)
    if not path.is_file():
        named = PLANS.get(str(path))
        if named is not None:
            return recognise_plan(named, "known by name")
        msg = f"{path}: no such file or folder, nor a measuring plan of that name"
        msg += did_you_mean(str(path), PLANS)
        raise MissingFileError(msg)
    if path.suffix == MODEL_SUFFIX or is_model_file(path):
        return _model(path)
    suffix = path.suffix.lower()
    if suffix in PLAN_SUFFIXES and is_plan(path):
        return recognise_plan(read_plan(path))
    reader = _READERS.get(suffix)
    if reader is None:
        raise _unknown(path)
    return reader(path)


def _unknown(path: Path) -> FormatError:
    msg = f"{path}: not something that exposight knows; it knows {_KNOWN}"
    return FormatError(msg)


# -- folders ------------------------------------------------------------------------------------


def _folder(path: Path) -> Recognised:
    if (path / "campaign.json").is_file():
        return _campaign(path)
    if (path / MESH_FILE).is_file():
        return _scene(path)
    frames = sorted(own for own in path.iterdir() if own.suffix.lower() in IMAGE_SUFFIXES)
    if not frames:
        raise _unknown(path)
    return recognise_frames(frames)


def _scene(path: Path) -> Recognised:
    scene = read_scene(path)
    return Recognised(
        kind="scene of the simulated cell",
        remark="watertight",
        facts=(
            fact("triangles", len(scene.faces), count(len(scene.faces))),
            fact(
                "features",
                [feature.name for feature in scene.part.features],
                f"{len(scene.part.features)}: {_first_names(scene.part.features)}",
            ),
        ),
    )


def _campaign(path: Path) -> Recognised:
    campaign = CampaignFolder(path)
    keys = campaign.keys()
    views = sorted({key.view for key in keys})
    exposures = sorted({key.exposure_ms for key in keys})
    emulated = clouds = 0
    with progress_bars() as progress:
        for done, capture in enumerate(campaign.captures(), start=1):  # verifies each, too
            emulated += capture.emulated
            clouds += capture.cloud is not None
            progress("verifying captures", done, len(campaign))
    shown = ", ".join(f"{exposure_ms:g}" for exposure_ms in exposures)
    simulated = (path / RECORD_FILE).is_file()
    return Recognised(
        kind="campaign",
        remark="every file verified",
        facts=(
            fact("name", campaign.name),
            fact("part", campaign.part.name),
            fact("features", len(campaign.part.features)),
            fact("sensor", campaign.sensor.name),
            fact("captures", len(campaign)),
            fact("with a cloud", clouds),
            fact("emulated", emulated),
            fact("simulated", simulated, "yes" if simulated else "no"),
            fact("views", views, f"{len(views)}: {', '.join(views[:6])}{' …' * (len(views) > 6)}"),
            fact("exposures ms", exposures, shown or "none yet"),
        ),
    )


# -- files of exposight's own -------------------------------------------------------------------


def _model(path: Path) -> Recognised:
    model = load_model(path, GaussianProcessModel)
    specification, summary, provenance = model.specification, model.summary, model.provenance
    ranges = model.training_range
    target = f"{specification.target}, {short_unit(specification.target) or '0 to 1'}"
    hyperparameters = model.hyperparameters()
    source = provenance.observations + (", partly or wholly emulated" * provenance.emulated)
    facts = [
        fact("model", specification.name, f"{specification.name}, {specification.source}"),
        fact("predicts", specification.target, target),
        *(
            fact(name, list(ranges[name]), f"trained on {span(ranges[name], short_unit(name))}")
            for name in specification.inputs
        ),
        fact("observations", model.n_observations, count(model.n_observations)),
        fact("from", provenance.observations, source),
        fact("emulated", provenance.emulated, "yes" if provenance.emulated else "no"),
        fact("sensor", model.sensor.name if model.sensor else None),
        fact(
            "log likelihood",
            summary.log_marginal_likelihood,
            number(summary.log_marginal_likelihood, 6),
        ),
        fact("converged", summary.converged, "yes" if summary.converged else "no"),
        fact(
            "at a limit",
            list(summary.parameters_at_bound),
            ", ".join(summary.parameters_at_bound) or "none",
        ),
        *(
            fact(own.name, own.value, f"{number(own.value)} {own.unit}".rstrip())
            for own in hyperparameters
        ),
        fact("seed", provenance.seed),
        fact("exposight version", provenance.exposight_version),
    ]
    return Recognised(kind="model", remark=f"{specification.title}; verified", facts=tuple(facts))


def _json(path: Path) -> Recognised:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        msg = f"{path}: not JSON ({error})"
        raise FormatError(msg) from error
    name = document.get("format") if isinstance(document, dict) else None
    if name == "exposight campaign":
        return _campaign(path.parent)
    if name == "exposight capture":
        msg = f"{path}: one capture of a campaign; ask about the campaign's folder"
        raise FormatError(msg)
    if name != "exposight sensor":
        raise _unknown(path)
    sensor = read_sensor(path)
    return Recognised(kind="sensor", facts=sensor_facts(sensor))


# -- tables -------------------------------------------------------------------------------------


def _csv(path: Path) -> Recognised:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        header = [cell.strip() for cell in file.readline().split(",")]
    if "exposure_ms" in header or "p_norm" in header:
        return _observations(path)
    if "kind" in header or "nx" in header:
        return _features(path)
    if header == ["x_mm", "y_mm", "z_mm"]:
        return recognise_cloud(path)
    msg = (
        f"{path}: a table of {', '.join(header[:8])}; expected observations (feature, view, "
        "exposure_ms, p_norm, …), features (name, kind, x_mm, …) or a cloud (x_mm, y_mm, z_mm)"
    )
    raise FormatError(msg)


def _observations(path: Path) -> Recognised:
    table = read_observations(path)
    measured = table.measured()
    counts = table.counts()
    emulated = int(table.frame["emulated"].sum())
    columns = ("exposure_ms", "p_norm", "i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
    values = measured.array(columns) if len(measured) else np.full((1, len(columns)), np.nan)
    told = ", ".join(f"{rows} {reason}" for reason, rows in counts.items())
    return Recognised(
        kind="observation table",
        facts=(
            fact("rows", len(table), count(len(table))),
            fact("features", len(set(table.names("feature")))),
            fact("views", len(set(table.names("view")))),
            fact("visibility", counts, told),
            fact("emulated", emulated, f"{count(emulated)} rows"),
            *(
                fact(name, limits(column), span(column, short_unit(name)))
                for name, column in zip(columns, values.T, strict=True)
            ),
        ),
    )


def _features(path: Path) -> Recognised:
    features = read_features(path)
    kinds = Counter(feature.kind for feature in features)
    radii = [feature.radius_mm for feature in features]
    return Recognised(
        kind="feature list",
        facts=(
            fact("features", len(features), f"{len(features)}: {_first_names(features)}"),
            fact("kinds", kinds, ", ".join(f"{n} {kind}" for kind, n in kinds.items())),
            fact("radius mm", [min(radii), max(radii)], span(radii, "mm")),
        ),
    )


def _first_names(features: tuple[Feature, ...]) -> str:
    names = ", ".join(feature.name for feature in features[:5])
    return names + (" …" if len(features) > 5 else "")


_READERS: dict[str, Callable[[Path], Recognised]] = {
    **dict.fromkeys(CLOUD_SUFFIXES, recognise_cloud),
    **dict.fromkeys(IMAGE_SUFFIXES, recognise_image),
    **dict.fromkeys(CALIBRATION_SUFFIXES, recognise_calibration),
    ".json": _json,
    ".csv": _csv,
    ".parquet": _observations,
    ".toml": recognise_sequence,
}
