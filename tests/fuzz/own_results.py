"""Files that exposight writes of what it learnt and decided: models, plans, loops, comparisons."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import tempfile
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tests.cell.conftest import small_capture, small_part, small_sensor
from tests.fuzz.formats import Format, Sample
from tests.fuzz.own_files import JSON_FAULTS, reseal_document
from tests.measuring.conftest import PlateDriver, plate_exposure_plan
from tests.models.conftest import train_quickly
from tests.models.rings import SENSOR, observed

from exposight.cell import CampaignFolder, CampaignWriter, Capture
from exposight.files import KeptFiles
from exposight.imaging.merging import RECORD, merge_captures, merge_record
from exposight.measuring.loop_state import LoopState, LoopStep, read_state
from exposight.measuring.record import keep_record, recorded_driver
from exposight.measuring.view_work import stored_observations
from exposight.models import (
    Predictor,
    load_model,
    model_named,
    model_sha256,
    save_model,
    train_window,
)
from exposight.observing import ObservationTable, Observer
from exposight.planning import ExposurePlan, SensorModels, read_exposure_plan
from exposight.planning.comparing.comparison import Comparison
from exposight.planning.comparing.comparison_files import read_comparison, write_comparison
from exposight.planning.comparing.view_outcomes import ViewOutcome
from exposight.plans import DepthPlane, MeasuringPlan

# -- models ---------------------------------------------------------------------------------------


def reseal_model(whole: bytes, data: bytes) -> bytes:
    """Return a model file whose members are sound and whose checksum is right.

    What was changed in the archive's own bytes stays so; a change in a member gets the member's own
    checksum, which ZIP keeps beside it.
    """
    if len(data) == len(whole):
        content = bytearray(data)
        with zipfile.ZipFile(io.BytesIO(whole)) as archive:
            for entry in archive.infolist():
                start = entry.header_offset + 30 + len(entry.filename)
                member = bytes(content[start : start + entry.file_size])
                if member != whole[start : start + entry.file_size]:
                    old = entry.CRC.to_bytes(4, "little")
                    new = zipfile.crc32(member).to_bytes(4, "little")
                    content = bytearray(bytes(content).replace(old, new))
        data = bytes(content)
    return data[:-64] + hashlib.sha256(data[:-64]).hexdigest().encode()


def _with_document(data: bytes, change: Any) -> bytes:
    """Return a model file whose document was changed, all else as a writer leaves it."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(buffer, "w") as other:
        for entry in archive.infolist():
            content = archive.read(entry)
            if entry.filename == "model.json":
                content = change(content)
            other.writestr(zipfile.ZipInfo(entry.filename), content)
        other.comment = b"0" * 64
    return reseal_model(b"", buffer.getvalue())


@cache
def _models() -> dict[str, bytes]:
    """Return model files by name: of the paper's kind and of the default kind."""
    models: list[Predictor] = [train_quickly(model_named("q_k2"), sensor=SENSOR)]
    window = train_window(observed(views=4, features=3), sensor=SENSOR)
    models += [train_quickly(model_named("e_k2"), sensor=SENSOR), window]
    files = {}
    with tempfile.TemporaryDirectory() as folder:
        for model in models:
            path = Path(folder) / f"{model.name}.exposight-model"
            save_model(path, model)
            files[path.name] = path.read_bytes()
    return files


def _model_samples(folder: Path) -> list[Sample]:
    for name, content in _models().items():
        (folder / name).write_bytes(content)
    return [Sample(folder / name) for name in _models()]


def _model_is_wrong(model: Predictor) -> str:
    numbers = [each.value for each in model.hyperparameters()]
    if not np.isfinite(numbers).all():
        return f"hyperparameters {numbers}"
    if model.n_observations < 1:
        return f"{model.n_observations} observations"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "again.exposight-model"
        save_model(path, model)
        again = load_model(path)
    if (again.name, again.target, again.inputs) != (model.name, model.target, model.inputs):
        return "written and read again it is another"
    if model.kind == "gaussian-process":
        said = model.predict(**dict.fromkeys(model.inputs, 20.0))
        if not (np.isfinite(said.mean).all() and np.isfinite(said.std).all()):
            return f"it predicts {said.mean} ± {said.std}"
    return ""


def _same_model(one: Predictor, other: Predictor) -> bool:
    return model_sha256(one) == model_sha256(other)


def _document_samples(folder: Path) -> list[Sample]:
    found = []
    for name, content in _models().items():
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            document = archive.read("model.json")
        (folder / f"{name}.json").write_bytes(document)
        found.append(Sample(folder / f"{name}.json"))
    return found


def _read_document(path: Path) -> Predictor:
    """Read a model whose document this is, its other members as they were."""
    whole = _models()[path.stem]
    file = path.with_suffix("")
    file.write_bytes(_with_document(whole, lambda _: path.read_bytes()))
    return load_model(file)


def _models_folder(folder: Path) -> list[Sample]:
    quality, exposure, default = _model_samples(folder)
    default.file.unlink()  # which would be taken before the others
    return [Sample(each.file, folder) for each in (quality, exposure)]


# -- plans and loops ------------------------------------------------------------------------------


def _plans(folder: Path) -> list[Sample]:
    path = folder / "plan.json"
    plate_exposure_plan().write(path)
    return [Sample(path)]


def _plan_is_wrong(plan: ExposurePlan) -> str:
    again = ExposurePlan(**vars(plan))
    if again.n_captures < 1 or not np.isfinite(again.time_ms) or again.time_ms <= 0:
        return f"{again.n_captures} captures in {again.time_ms} ms"
    proof, promise = plan.certificate, plan.promise
    if min(proof.objective, proof.bound, proof.seconds, proof.gap) < 0:
        return f"a certificate {proof}"
    n = len(plan.features)
    if not (0 <= promise.expected_covered <= n and 0 <= promise.expected_misses <= n):
        return f"a promise {promise} of {n} features"
    if not (0 <= promise.chance_of_all <= 1 and 0 <= promise.chance_of_all_if_independent <= 1):
        return f"a promise {promise}"
    for view in plan.views:
        orders = [each.order for each in view.exposures]
        times = [each.exposure_ms for each in view.exposures]
        if sorted(orders) != list(range(1, len(orders) + 1)) or len(set(times)) < len(times):
            return f"captures numbered {orders} at {times}"
        known = {each.feature for each in plan.features}
        if unknown := {name for each in view.exposures for name in each.covers} - known:
            return f"a capture for features that are not there: {unknown}"
    costs = plan.costs
    if any(value < 0 for value in vars(costs).values() if isinstance(value, float)):
        return f"costs {costs}"
    _ = (str(plan), plan.notes, plan.proof, plan.frame)
    return ""


@cache
def _fed_state() -> tuple[bytes, bytes]:
    """Return a state of a loop that was fed two captures, and its model's file."""
    driver = PlateDriver()
    model = train_window(
        observed(
            views=4,
            features=3,
            sensor=driver.sensor,
            part="plate",
            exposures_ms=(1.0, 2.0, 5.0, 10.0, 20.0, 50.0),
        ),
        sensor=driver.sensor,
        mean="none",
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "quality.exposight-model"
        save_model(path, model)
        content = path.read_bytes()
        state = LoopState.begin(
            plate_exposure_plan(), [path], part=driver.part, sensor=driver.sensor
        )
        step = LoopStep(Path(folder) / "state.json", state)
        observer = Observer(driver.part, driver.sensor)
        for exposure_ms in (1.0, 10.0):
            pose = step.plan.views[0].camera_from_part
            capture = driver.capture(exposure_ms, pose, view="near")
            table = ObservationTable.from_observations(observer.observe(capture))
            file = Path(folder) / "table.csv"
            table.write(file)
            step.feed(file)
        step.save()
        return (Path(folder) / "state.json").read_bytes(), content


def _states(folder: Path) -> list[Sample]:
    content, learnt = _fed_state()
    document = json.loads(content)
    model = folder / "quality.exposight-model"
    model.write_bytes(learnt)
    document["models"] = [str(model)]
    path = folder / "state.json"
    path.write_bytes(reseal_document(b"", json.dumps(document).encode()))
    return [Sample(path)]


def _read_state(path: Path) -> tuple[LoopState, str]:
    state = read_state(path)
    step = LoopStep(path, state)
    return state, f"{step.request()} {step.verdict}"


def _state_is_wrong(read: tuple[LoopState, str]) -> str:
    views = json.loads(read[0].plan)["views"]
    names = {each["name"] for each in views}
    for capture in read[0].captures:
        rows = capture.rows.frame
        if capture.view not in names or set(rows["view"]) != {capture.view}:
            return f"a capture of {capture.view} with rows of {set(rows['view'])}"
        if set(rows["exposure_ms"]) != {capture.exposure_ms}:
            return "a capture with rows of another exposure time"
    return ""


# -- comparisons ----------------------------------------------------------------------------------


def _comparisons(folder: Path) -> list[Sample]:
    outcomes = tuple(
        ViewOutcome(
            strategy=strategy,
            kind=kind,
            title=strategy,
            view=view,
            coverable=3,
            had=2,
            captures_ms=(2.0, 8.0),
            trial_images_ms=(4.0,),
            time_s=1.5,
            promises=2,
            promised=1.9,
            kept=2,
            promise_loss=0.01,
            chances=6,
            chance_loss=0.2,
        )
        for view in ("v1", "v2")
        for strategy, kind in (("oracle", "oracle"), ("rival", "rival"))
    )
    comparison = Comparison(
        outcomes=outcomes, sweep="sweep.csv", sweep_sha256="ab" * 32, about={"seed": 1}
    )
    write_comparison(comparison, folder)
    return [Sample(folder / "results.json", folder)]


def _comparison_is_wrong(comparison: Comparison) -> str:
    keys = [(each.strategy, each.view) for each in comparison.outcomes]
    if len(set(keys)) < len(keys):
        return "a strategy twice in one view"
    for each in comparison.outcomes:
        counts = (each.had, each.coverable, each.promises, each.kept, each.chances)
        losses = (each.time_s, each.promised, each.promise_loss, each.chance_loss)
        if min(*counts, *losses) < 0 or each.had > each.coverable or each.kept > each.promises:
            return f"counts {counts}, sums {losses}"
        if each.promised > each.promises or min((*each.captures_ms, 1.0)) <= 0:
            return f"{each.promised} promised of {each.promises}"
    _ = comparison.scores
    with tempfile.TemporaryDirectory() as folder:
        write_comparison(comparison, folder)
        if repr(read_comparison(folder).outcomes) != repr(comparison.outcomes):
            return "written and read again it is another"
    return ""


# -- kept pieces, records, merged captures --------------------------------------------------------


def _kept(folder: Path) -> list[Sample]:
    kept = KeptFiles(folder, "a plan", "a driver")
    kept.keep("000000.csv", b"feature,view\nf1,v1\n")
    path = kept.path("000000.csv")
    return [Sample(path, folder), Sample(path.with_suffix(".sha256"), folder)]


def _find_kept(folder: Path) -> bytes:
    """Return what is found; what is not believed is made again."""
    kept = KeptFiles(folder, "a plan", "a driver")
    found = kept.find("000000.csv")
    if found is None:
        kept.keep("000000.csv", b"feature,view\nf1,v1\n")
        found = kept.path("000000.csv")
    return found.read_bytes()


def _records(folder: Path) -> list[Sample]:
    plan = MeasuringPlan(
        name="few",
        sensor=small_sensor(),
        features=("h1",),
        reference="h1",
        planes=(DepthPlane(name="p", z_tcp_mm=0.0, x_mm=(0.0,), y_mm=(0.0,), exposures_ms=(1.0,)),),
    )
    keep_record(
        folder, plan=plan, description={"driver": "mine", "n": [1, 2.5]}, clouds=True, n_captures=0
    )
    return [Sample(folder / "measurement.json", folder)]


@cache
def _merged_capture() -> Capture:
    return merge_captures([small_capture(10.0), small_capture(20.0)])


def _merged(folder: Path) -> list[Sample]:
    path = folder / RECORD
    path.write_bytes(_merged_capture().attachments[RECORD])
    return [Sample(path)]


def _read_merged(path: Path) -> Any:
    merged = _merged_capture()
    capture = replace(merged, attachments={**merged.attachments, RECORD: path.read_bytes()})
    return merge_record(capture)


def _merged_is_wrong(record: Any) -> str:
    times = record.exposures_ms
    if list(times) != sorted(set(times)) or min(times) <= 0 or len(times) != len(record.points):
        return f"exposure times {times}, points {record.points}"
    return "" if min(record.points) >= 0 else f"points {record.points}"


@cache
def _rows() -> bytes:
    """Return a capture's observations as they lie beside it."""
    driver = PlateDriver()
    pose = plate_exposure_plan().views[0].camera_from_part
    capture = driver.capture(4.0, pose, view="near")
    table = ObservationTable.from_observations(
        Observer(driver.part, driver.sensor).observe(capture)
    )
    return table.frame.write_csv().encode()


def _stored_rows(folder: Path) -> list[Sample]:
    path = folder / "rows.csv"
    path.write_bytes(_rows())
    return [Sample(path)]


def _read_stored_rows(path: Path) -> ObservationTable:
    root = path.with_name("campaign")
    shutil.rmtree(root, ignore_errors=True)
    capture = replace(
        small_capture(4.0, "near"), cloud=None, attachments={"observations.csv": path.read_bytes()}
    )
    part = small_part()
    with CampaignWriter.open_or_create(root, name="c", sensor=small_sensor(), part=part) as writer:
        writer.add(capture)
    campaign = CampaignFolder(root)
    return stored_observations(campaign, 0, next(campaign.descriptions()))


def _rows_are_wrong(table: ObservationTable) -> str:
    frame = table.frame
    if set(frame["view"]) != {"near"} or set(frame["exposure_ms"]) != {4.0}:
        return "rows of another capture"
    return "a feature twice" if frame["feature"].is_duplicated().any() else ""


FORMATS = (
    Format(
        "model file",
        _model_samples,
        load_model,
        wrong=_model_is_wrong,
        sealed=True,
        reseal=reseal_model,
        same=_same_model,
    ),
    Format("document of a model", _document_samples, _read_document, wrong=_model_is_wrong,
           faults=JSON_FAULTS),
    Format(
        "folder of models",
        _models_folder,
        SensorModels.load,
        wrong=lambda models: _model_is_wrong(models.quality) or _model_is_wrong(models.exposure),
        sealed=True,
        reseal=reseal_model,
        same=lambda one, other: one.checksums == other.checksums,
    ),
    Format("exposure plan", _plans, read_exposure_plan, wrong=_plan_is_wrong, faults=JSON_FAULTS),
    Format(
        "state of a loop",
        _states,
        _read_state,
        wrong=_state_is_wrong,
        faults=JSON_FAULTS,
        sealed=True,
        reseal=reseal_document,
        slow=True,
    ),
    Format("comparison", _comparisons, read_comparison, wrong=_comparison_is_wrong,
           faults=JSON_FAULTS, same=lambda one, other: repr(one) == repr(other)),
    Format("kept piece", _kept, _find_kept, sealed=True),
    Format(
        "record of a measurement",
        _records,
        recorded_driver,
        faults=JSON_FAULTS,
        sealed=True,
        reseal=reseal_document,
    ),
    Format("record of a merged capture", _merged, _read_merged, wrong=_merged_is_wrong,
           faults=JSON_FAULTS),
    Format("observations of a capture", _stored_rows, _read_stored_rows, wrong=_rows_are_wrong),
)  # fmt: skip
