"""The main job, end to end, on the recorded skull.

Stripes are decoded to a point cloud, ring features are placed on it, an exposure sweep is emulated
from the recorded frames, every feature is observed at every exposure, and all of the paper's models
are trained on half of the features and judged by the other half.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import (
    ActiveSensor,
    CampaignFolder,
    CampaignWriter,
    Capture,
    Cloud,
    Part,
    write_features,
)
from exposight.demo.recording import (
    NOMINAL_EXPOSURE_MS,
    SkullRecording,
    decode_to_cloud,
    find_skull,
    read_skull,
    skull_sensor,
)
from exposight.demo.result import DemoResult, DemoSettings, ModelResult, SequenceCheck
from exposight.demo.surface_features import place_features
from exposight.errors import FileError, InputError
from exposight.evaluation import split_by_group
from exposight.geometry import RigidTransform
from exposight.imaging import (
    compare_along_rays,
    re_expose,
    sequence_preset,
)
from exposight.models import (
    MODEL_SUFFIX,
    ModelSpecification,
    evaluate,
    save_model,
    train,
)
from exposight.observing import (
    FeatureView,
    ObservationTable,
    Visibility,
    observe_campaign,
    view_features,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, what of it is done, and how much there is."""

_VIEW = "skull"
_STRIPE_FRAME = 0  # the first of the sixteen-period fringes: the finest stripes of the recording


def run_demo(
    output: str | Path,
    data: str | Path | None = None,
    settings: DemoSettings | None = None,
    progress: Progress | None = None,
) -> DemoResult:
    """Run the whole method on the recorded skull.

    Whatever was captured stays in ``output/campaign``; run again, only what is missing is made.

    Parameters
    ----------
    output : path
        Folder for campaign, observations and models; made if it is not there.
    data : path, optional
        Where the recording is; see `find_skull`.
    settings : DemoSettings, optional
        What to do.
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    MissingFileError
        If the recording cannot be found; the message says what is needed.
    InputError
        If the settings make no sense, or the folder holds a demonstration of other settings.
    """
    settings = settings or DemoSettings()
    tell = progress or _silent
    _check_settings(settings)
    skull = find_skull(data)
    folder = _make_folder(Path(output))
    tell("reading frames", 0, 1)
    recording = read_skull(skull)
    tell("reading frames", 1, 1)
    checks, cloud = _check_decoding(recording, tell)
    sensor = skull_sensor(recording.rig, cloud)
    tell("placing features", 0, 1)
    features = place_features(
        cloud, sensor, count=settings.features, rng=np.random.default_rng(settings.seed)
    )
    part = Part(name="skull", features=features)
    tell("placing features", 1, 1)
    try:
        campaign = _sweep(folder / "campaign", recording, sensor, part, settings, tell)
    except InputError as error:
        msg = f"{error} (it holds a demonstration of another seed or number of features)"
        raise InputError(msg) from error
    write_features(folder / "features.csv", features)
    table = observe_campaign(campaign, progress=lambda done, n: tell("observing", done, n))
    table.write(folder / "observations.csv")
    split = split_by_group(table.names("feature"), 0.5, np.random.default_rng(settings.seed))
    trains = np.isin(np.arange(len(table)), split.train)
    jobs = [
        (specification, table.where(trains), table.where(~trains), sensor, settings)
        for specification in settings.models
    ]
    models = _make_folder(folder / "models")
    results = []
    tell("training models", 0, len(jobs))
    for result in _train_all(jobs, settings.workers):
        save_model(models / f"{result.model.specification.name}{MODEL_SUFFIX}", result.model)
        results.append(result)
        tell("training models", len(results), len(jobs))
    results.sort(key=lambda found: settings.models.index(found.model.specification))
    views = view_features(part, sensor, RigidTransform())
    train_features = frozenset(table.names("feature")[trains].tolist())
    return DemoResult(
        settings=settings,
        output=folder,
        sensor=sensor,
        checks=checks,
        sweep=_three_captures(campaign, settings),
        cloud=cloud,
        views=views,
        table=table,
        train_features=train_features,
        overlap=_ring_overlap(views, train_features, recording.phase.image_shape),
        results=tuple(results),
    )


def _silent(stage: str, done: int, total: int) -> None:
    """Tell nobody."""


def _check_settings(settings: DemoSettings) -> None:
    numbers = (settings.features, settings.restarts, settings.workers, settings.steps_per_decade)
    if min(numbers) < 1 or settings.features < 4 or settings.steps_each_way < 1:
        msg = (
            "the demonstration needs at least 4 features and 1 of steps, restarts and workers, "
            f"got {settings.features} features, {settings.steps_each_way} steps each way, "
            f"{settings.restarts} restarts, {settings.workers} workers"
        )
        raise InputError(msg)


def _make_folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"{folder} cannot be used for output: {error.strerror or error}"
        raise FileError(msg) from error
    return folder


def _check_decoding(
    recording: SkullRecording, tell: Progress
) -> tuple[tuple[SequenceCheck, ...], Cloud]:
    """Decode both sequences, compare them, and return the phase shift's cloud too."""
    checks = []
    sequences = (
        ("Gray code, 12 frames", "skull_gray", recording.gray),
        ("phase shift, 6 frames", "skull_2x3", recording.phase),
    )
    for done, (title, name, stack) in enumerate(sequences):
        tell("decoding", done, len(sequences))
        start = time.perf_counter()
        decoded, cloud = decode_to_cloud(stack, sequence_preset(name), recording.rig)
        seconds = time.perf_counter() - start
        checks.append(
            SequenceCheck(
                title=title,
                counts=decoded.counts(),
                agreement=compare_along_rays(cloud, recording.authors_points, recording.rig.camera),
                seconds=seconds,
            )
        )
    tell("decoding", len(sequences), len(sequences))
    return tuple(checks), cloud


def _sweep(
    folder: Path,
    recording: SkullRecording,
    sensor: ActiveSensor,
    part: Part,
    settings: DemoSettings,
    tell: Progress,
) -> CampaignFolder:
    """Emulate the exposure sweep into a campaign's folder; captures that are there stay."""
    exposures = settings.exposures_ms()
    sequence = sequence_preset("skull_2x3")
    with CampaignWriter.open_or_create(
        folder, name="skull, emulated exposure sweep", sensor=sensor, part=part
    ) as writer:
        for done, exposure_ms in enumerate(exposures):
            tell("emulating exposures", done, len(exposures))
            if writer.has(_VIEW, exposure_ms):
                continue
            recorded = exposure_ms == NOMINAL_EXPOSURE_MS
            factor = exposure_ms / NOMINAL_EXPOSURE_MS
            stack = recording.phase if recorded else re_expose(recording.phase, factor)
            _, cloud = decode_to_cloud(stack, sequence, recording.rig)
            writer.add(
                Capture(
                    view=_VIEW,
                    exposure_ms=exposure_ms,
                    image=stack.frames[_STRIPE_FRAME],
                    cloud=cloud,
                    camera_from_part=RigidTransform(),
                    emulated=stack.emulated,
                    notes="recorded, nominal exposure"
                    if recorded
                    else f"recorded grey values times {factor:.4g}, rounded, clipped at 255",
                )
            )
    tell("emulating exposures", len(exposures), len(exposures))
    return CampaignFolder(folder)


_Job = tuple[ModelSpecification, ObservationTable, ObservationTable, ActiveSensor, DemoSettings]


def _train_all(jobs: list[_Job], workers: int) -> Iterator[ModelResult]:
    """Train models, several at a time, and yield each as soon as it is done."""
    if workers == 1:
        yield from (_train_one(*job) for job in jobs)
        return
    # Fresh processes: forking one that has run compiled threads can hang.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=min(workers, len(jobs)), mp_context=context) as pool:
        try:
            futures = [pool.submit(_train_one, *job) for job in jobs]
            yield from (future.result() for future in as_completed(futures))
        except BaseException:  # an interrupt too: do not begin what is still waiting
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _train_one(
    specification: ModelSpecification,
    known: ObservationTable,
    unseen: ObservationTable,
    sensor: ActiveSensor,
    settings: DemoSettings,
) -> ModelResult:
    start = time.perf_counter()
    model = train(
        specification,
        known,
        seed=settings.seed,
        source="half of the features of the skull's emulated exposure sweep",
        sensor=sensor,
        restarts=settings.restarts,
    )
    seconds = time.perf_counter() - start
    return ModelResult(
        model=model,
        known=evaluate(model, known),
        unseen=evaluate(model, unseen),
        seconds=seconds,
    )


def _three_captures(campaign: CampaignFolder, settings: DemoSettings) -> tuple[Capture, ...]:
    exposures = settings.exposures_ms()
    wanted = {exposures[1], NOMINAL_EXPOSURE_MS, exposures[-2]}
    found = (capture for capture in campaign.captures() if capture.exposure_ms in wanted)
    return tuple(sorted(found, key=lambda capture: capture.exposure_ms))


def _ring_overlap(
    views: tuple[FeatureView, ...], train_features: frozenset[str], shape: tuple[int, int]
) -> float:
    """Tell which share of the unseen features' rings was seen in training all the same."""
    seen: NDArray[np.bool_] = np.zeros(shape, dtype=np.bool_)
    unseen = []
    for view in views:
        if view.visibility is not Visibility.VISIBLE:
            continue
        if view.feature.name in train_features:
            seen[view.rows, view.columns] = True
        else:
            unseen.append(view)
    pixels = sum(view.n_pixels for view in unseen)
    shared = sum(int(seen[view.rows, view.columns].sum()) for view in unseen)
    return shared / pixels if pixels else 0.0
