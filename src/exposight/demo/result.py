"""What the demonstration is asked for and what it found: plain records, drawn by the report."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from exposight.demo.recording import NOMINAL_EXPOSURE_MS
from exposight.models import MODELS

if TYPE_CHECKING:
    from exposight.cell import ActiveSensor, Capture, Cloud
    from exposight.imaging import CloudAgreement, DecodingCounts
    from exposight.models import Evaluation, ModelSpecification, TrainedModel
    from exposight.observing import FeatureView, ObservationTable


@dataclass(frozen=True, kw_only=True)
class DemoSettings:
    """What the demonstration does.

    Parameters
    ----------
    features : int
        Ring features to place, half of which train.
    steps_per_decade : int
        Of the emulated exposure sweep, a geometric progression through the nominal exposure.
    steps_each_way : int
        Steps below and above the nominal exposure.
    seed : int
        Of places, radii, the split and the restarts.
    restarts : int
        Starts of each model's optimiser; the paper took three.
    models : tuple of ModelSpecification
        Which ones are trained.
    workers : int
        Processes that train at the same time.
    """

    features: int = 220
    steps_per_decade: int = 8
    steps_each_way: int = 6
    seed: int = 1
    restarts: int = 3
    models: tuple[ModelSpecification, ...] = MODELS
    workers: int = max(1, os.cpu_count() or 1)

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
class ModelResult:
    """A trained model, judged by the features it knows and by those it has never seen."""

    model: TrainedModel
    known: Evaluation
    unseen: Evaluation
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DemoResult:
    """Everything the demonstration found.

    Parameters
    ----------
    settings : DemoSettings
        What was asked for.
    output : Path
        Folder in which campaign, table and models are.
    sensor : ActiveSensor
        The recording's rig.
    checks : tuple of SequenceCheck
        Gray code and phase shift against the authors' cloud.
    sweep : tuple of Capture
        Three captures of the sweep: dark, nominal, bright.
    cloud : Cloud
        At the nominal exposure.
    views : tuple of FeatureView
        The features, their masks and poses.
    table : ObservationTable
        All observations.
    train_features : frozenset of str
        Names of the features that trained.
    overlap : float
        Share of the unseen features' ring pixels that lie in a training feature's ring too.
    results : tuple of ModelResult
        One for each model.
    """

    settings: DemoSettings
    output: Path
    sensor: ActiveSensor
    checks: tuple[SequenceCheck, ...]
    sweep: tuple[Capture, ...]
    cloud: Cloud
    views: tuple[FeatureView, ...]
    table: ObservationTable
    train_features: frozenset[str]
    overlap: float
    results: tuple[ModelResult, ...]
