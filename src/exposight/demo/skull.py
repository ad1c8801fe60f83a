"""The whole method on a recording: a skull, scanned once, its exposure sweep emulated.

Stripes are decoded to a point cloud, ring features are placed on it, an exposure sweep is emulated
from the recorded frames, every feature is observed at every exposure, and all of the paper's models
are trained on half of the features and judged by the other half.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
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
from exposight.demo.result import DemoResult, DemoSettings
from exposight.demo.surface_features import place_features
from exposight.demo.training import Lesson, Progress, make_folder, silent, train_models
from exposight.errors import InputError
from exposight.geometry import RigidTransform
from exposight.imaging import (
    compare_along_rays,
    re_expose,
    sequence_preset,
)
from exposight.observing import (
    FeatureView,
    Visibility,
    observe_campaign,
    view_features,
)
from exposight.statistics import split_by_group

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.imaging import CloudAgreement, DecodingCounts

_VIEW = "skull"
_STRIPE_FRAME = 0  # the first of the sixteen-period fringes: the finest stripes of the recording


@dataclass(frozen=True, kw_only=True)
class SkullSettings(DemoSettings):
    """What the demonstration on the skull does.

    Parameters
    ----------
    features : int
        Ring features to place, half of which train.
    steps_per_decade : int
        Of the emulated exposure sweep, a geometric progression through the nominal exposure.
    steps_each_way : int
        Steps below and above the nominal exposure.

    Raises
    ------
    InputError
        If there are fewer than 4 features or less than 1 step, or as for `DemoSettings`.
    """

    features: int = 220
    steps_per_decade: int = 8
    steps_each_way: int = 6

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.features < 4 or min(self.steps_per_decade, self.steps_each_way) < 1:
            msg = (
                "the demonstration needs at least 4 features and 1 step of exposure, got "
                f"{self.features} features, {self.steps_per_decade} steps a decade, "
                f"{self.steps_each_way} steps each way"
            )
            raise InputError(msg)

    def exposures_ms(self) -> tuple[float, ...]:
        """Return the sweep's exposure times in ms, the nominal one among them."""
        steps = range(-self.steps_each_way, self.steps_each_way + 1)
        factors = (10.0 ** (step / self.steps_per_decade) for step in steps)
        return tuple(round(NOMINAL_EXPOSURE_MS * factor, 3) for factor in factors)


@dataclass(frozen=True, kw_only=True, eq=False)
class SequenceCheck:
    """How one decoded sequence compares with the authors' cloud."""

    title: str
    counts: DecodingCounts
    agreement: CloudAgreement
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SkullResult(DemoResult):
    """Everything the demonstration on the skull found.

    Parameters
    ----------
    settings : SkullSettings
        What was asked for.
    checks : tuple of SequenceCheck
        Gray code and phase shift against the authors' cloud.
    sweep : tuple of Capture
        Three captures of the sweep: dark, nominal, bright.
    cloud : Cloud
        At the nominal exposure.
    views : tuple of FeatureView
        The features, their masks and poses.
    overlap : float
        Share of the unseen features' ring pixels that lie in a training feature's ring too.
    """

    settings: SkullSettings
    checks: tuple[SequenceCheck, ...]
    sweep: tuple[Capture, ...]
    cloud: Cloud
    views: tuple[FeatureView, ...]
    overlap: float


def run_skull(
    output: str | Path,
    data: str | Path | None = None,
    settings: SkullSettings | None = None,
    progress: Progress | None = None,
) -> SkullResult:
    """Run the whole method on the recorded skull.

    Whatever was captured stays in ``output/campaign``; run again, only what is missing is made.

    Parameters
    ----------
    output : path
        Folder for campaign, observations and models; made if it is not there.
    data : path, optional
        Where the recording is; see `find_skull`.
    settings : SkullSettings, optional
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
    settings = settings or SkullSettings()
    tell = progress or silent
    skull = find_skull(data)
    folder = make_folder(Path(output))
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
    table = observe_campaign(campaign, progress=tell)
    table.write(folder / "observations.csv")
    split = split_by_group(table.names("feature"), 0.5, np.random.default_rng(settings.seed))
    trains = np.isin(np.arange(len(table)), split.train)
    lesson = Lesson(
        known=table.where(trains),
        unseen=table.where(~trains),
        sensor=sensor,
        source="half of the features of the skull's emulated exposure sweep",
    )
    results = train_models(folder / "models", lesson, settings, tell)
    views = view_features(part, sensor, RigidTransform())
    train_features = frozenset(table.names("feature")[trains].tolist())
    return SkullResult(
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
        results=results,
    )


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
    settings: SkullSettings,
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


def _three_captures(campaign: CampaignFolder, settings: SkullSettings) -> tuple[Capture, ...]:
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
