"""The datasets of the paper's Table 9, taken from the campaigns' observations.

Several datasets come from one campaign: the exposure models' are the quality models' without the
rows below p_norm 0.75 (Sect. 3.4.1), and test features are measured in the same views. Names are
plain: ``eX_plusplus`` is ᵉX⁺⁺, and those of the stereo sensor begin with ``s2_``.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.models import P_NORM_MIN
from exposight.observing import ObservationTable
from exposight.paper.study_settings import SensorKind, StudySettings
from exposight.statistics import Split, inside_box, random_split, split_by_group

TRAINING: Final = ("f1", "f2", "f3", "f4")
TRAINING_PLUS: Final = (*TRAINING, "f5", "f6", "f7", "f8", "f9")
TEST: Final = ("f1_test", "f2_test", "f3_test", "f4_test")
OUTSIDE: Final = ("f1_out", "f2_out", "f3_out", "f4_out", "f5_out")

POSITION: Final = ("x_mm", "y_mm", "z_mm")
POSE: Final = (*POSITION, "w_deg", "p_deg")
"""Columns whose training range decides what is "test,i" (Sect. 3.4.7)."""

_TRAIN_SHARE = 0.8
_STEREO_TRAIN_SHARE = 0.2
"""Sect. 4.2.1: enough, of so many observations."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """One row of the paper's Table 9: measured observations of one kind, and how they are split.

    Parameters
    ----------
    name : str
        ``X``, ``X_test``, ``eX``, ``eX_test``, ``eX_plus``, ``eX_plusplus``, ``X_lighting_I`` (II,
        III), ``X_out``, and ``s2_X``, ``s2_X_test``, ``s2_eX``, ``s2_eX_test``, ``s2_X_out``.
    title : str
        For people.
    sensor : {'structured-light', 'stereo'}
        Which sensor measured it.
    features : tuple of str
        Requested features, including those of which no row is left.
    p_norm_min : float or None
        Rows below are left out (Sect. 3.4.1); None keeps all.
    table : ObservationTable
        All its rows, measured ones only.
    train, validation : ObservationTable or None
        The two sides of the random split, as in the paper; None where no model is trained on it.
    train_by_view, validation_by_view : ObservationTable or None
        The two sides of a split by whole views with the same share.
    """

    name: str
    title: str
    sensor: SensorKind
    features: tuple[str, ...]
    p_norm_min: float | None
    table: ObservationTable
    train: ObservationTable | None = None
    validation: ObservationTable | None = None
    train_by_view: ObservationTable | None = None
    validation_by_view: ObservationTable | None = None


@dataclass(frozen=True, kw_only=True)
class DatasetDefinition:
    """How a dataset is taken from the campaigns.

    Parameters
    ----------
    name, title : str
        Name, and title for people.
    sensor : {'structured-light', 'stereo'}
        Sensor that measures it.
    campaigns : tuple of str
        Campaigns (`exposight.paper.campaigns`) whose rows it has.
    features : tuple of str
        The features that it keeps.
    p_norm_min : float or None
        Least quality of its rows.
    splits : bool
        Whether a model is trained on it.
    """

    name: str
    title: str
    sensor: SensorKind
    campaigns: tuple[str, ...]
    features: tuple[str, ...]
    p_norm_min: float | None = None
    splits: bool = False

    def train_share(self, settings: StudySettings) -> float:
        """Return the share that trains.

        A quick study has so few stereo observations that it trains on as many as elsewhere.
        """
        if self.sensor == "stereo" and not settings.quick:
            return _STEREO_TRAIN_SHARE
        return _TRAIN_SHARE


def _quality_and_exposure(
    prefix: str, sensor: SensorKind, campaign: str, whose: str
) -> tuple[DatasetDefinition, ...]:
    return tuple(
        DatasetDefinition(
            name=f"{prefix}{name}",
            title=f"{whose}{title}",
            sensor=sensor,
            campaigns=(campaign,),
            features=features,
            p_norm_min=p_norm_min,
            splits=features == TRAINING,
        )
        for name, title, features, p_norm_min in (
            ("X", "four features", TRAINING, None),
            ("X_test", "four unseen features", TEST, None),
            ("eX", "four features, p_norm ≥ 0.75", TRAINING, P_NORM_MIN),
            ("eX_test", "four unseen features, p_norm ≥ 0.75", TEST, P_NORM_MIN),
        )
    )


DATASETS: Final = (
    *_quality_and_exposure("", "structured-light", "inside", ""),
    DatasetDefinition(
        name="eX_plus",
        title="nine features, p_norm ≥ 0.75",
        sensor="structured-light",
        campaigns=("inside",),
        features=TRAINING_PLUS,
        p_norm_min=P_NORM_MIN,
        splits=True,
    ),
    DatasetDefinition(
        name="eX_plusplus",
        title="nine features, finer steps, p_norm ≥ 0.75",
        sensor="structured-light",
        campaigns=("inside", "finer"),
        features=TRAINING_PLUS,
        p_norm_min=P_NORM_MIN,
        splits=True,
    ),
    *(
        DatasetDefinition(
            name=f"X_lighting_{scenario}",
            title=f"three unseen features, lighting {scenario}",
            sensor="structured-light",
            campaigns=(f"lighting-{number}",),
            features=TEST[:3],
        )
        for number, scenario in enumerate(("I", "II", "III"), start=1)
    ),
    DatasetDefinition(
        name="X_out",
        title="five outside features of other finishes",
        sensor="structured-light",
        campaigns=("outside",),
        features=OUTSIDE,
    ),
    *_quality_and_exposure("s2_", "stereo", "stereo-inside", "stereo sensor, "),
    DatasetDefinition(
        name="s2_X_out",
        title="stereo sensor, five outside features of other finishes",
        sensor="stereo",
        campaigns=("stereo-outside",),
        features=OUTSIDE,
    ),
)
"""All of Table 9, in its order."""


def build_dataset(
    definition: DatasetDefinition,
    tables: Mapping[str, ObservationTable],
    settings: StudySettings,
) -> Dataset:
    """Take a dataset from the campaigns' observations and split it.

    Parameters
    ----------
    definition : DatasetDefinition
        Which one.
    tables : mapping of str to ObservationTable
        Observations by campaign; campaigns that were not measured are absent.
    settings : StudySettings
        Seed of the splits. What is drawn depends on it and the dataset's name alone.

    Returns
    -------
    Dataset
        Not split where it has no row, or as its definition says.

    Raises
    ------
    ObservationError
        If it has too few rows or views to be split.
    """
    measured = [tables[name] for name in definition.campaigns if name in tables]
    table = concatenated(measured).measured()
    table = table.where(np.isin(table.names("feature"), definition.features))
    if definition.p_norm_min is not None:
        table = table.with_quality(definition.p_norm_min)
    whole = Dataset(
        name=definition.name,
        title=definition.title,
        sensor=definition.sensor,
        features=definition.features,
        p_norm_min=definition.p_norm_min,
        table=table,
    )
    if not definition.splits or len(table) == 0:
        return whole
    share = definition.train_share(settings)
    # One generator for each dataset, so that none depends on which others are built.
    rng = np.random.default_rng([settings.seed, zlib.crc32(definition.name.encode())])
    train, validation = _sides(table, random_split(len(table), share, rng))
    by_view = split_by_group(table.names("view").astype(str), share, rng)
    train_by_view, validation_by_view = _sides(table, by_view)
    return replace(
        whole,
        train=train,
        validation=validation,
        train_by_view=train_by_view,
        validation_by_view=validation_by_view,
    )


def concatenated(tables: list[ObservationTable]) -> ObservationTable:
    """Return the rows of several tables, or of none, as one."""
    if not tables:
        return ObservationTable.from_observations([])
    return ObservationTable(frame=pl.concat(table.frame for table in tables))


def inside_range(
    train: ObservationTable, query: ObservationTable, columns: tuple[str, ...]
) -> NDArray[np.bool_]:
    """Return which rows lie inside the training rows' range, at the resolution of Table 9.

    The paper prints ranges in whole mm and degrees. Rounding to them matters for the angles only:
    every feature has but one orientation, so that sharper limits would be drawn by the alignment's
    noise of a few hundredths of a degree.

    Parameters
    ----------
    train, query : ObservationTable
        Rows that span the range, at least one; rows to test.
    columns : tuple of str
        Such as `POSE`.

    Returns
    -------
    (n,) ndarray of bool
        For each row of `query`; both ends are inside.
    """
    return inside_box(np.round(train.array(columns)), np.round(query.array(columns)))


def _sides(table: ObservationTable, split: Split) -> tuple[ObservationTable, ObservationTable]:
    return tuple(ObservationTable(frame=table.frame[rows]) for rows in (split.train, split.test))  # type: ignore[return-value]
