"""The paper's own figures, kept as data in the package: facts, copied from its tables.

``data/scores.csv`` holds Tables 2 to 6, ``data/hyperparameters.csv`` Table 8 (a product's variances
multiplied, since only that matters), ``data/datasets.csv`` Table 9.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


RANGES = ("p_norm", "i_avg", "exposure_ms", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
"""Columns of which Table 9 prints the range; r is 0 throughout."""


@dataclass(frozen=True, kw_only=True)
class PublishedScore:
    """A line of Tables 2 to 6.

    Parameters
    ----------
    table : int
        Its number.
    rung, dataset, features : str
        As the paper names kernel, evaluation dataset and features, written plainly.
    r2_percent, mse, rmse : float
        MSE in squared units of the target; RMSE in percent of full scale, or in ms.
    """

    table: int
    rung: str
    dataset: str
    features: str
    r2_percent: float
    mse: float
    rmse: float


@dataclass(frozen=True, kw_only=True)
class PublishedDataset:
    """A line of Table 9.

    Parameters
    ----------
    dataset, features : str
        As the paper names them, written plainly.
    n, n_train : int or None
        Observations, and those trained on, where it says.
    ranges : dict of str to (float, float)
        Least and greatest value of each of `RANGES` that is printed.
    """

    dataset: str
    features: str
    n: int
    n_train: int | None
    ranges: dict[str, tuple[float, float]]


@cache
def published_scores() -> dict[tuple[str, str, str], PublishedScore]:
    """Return Tables 2 to 6 by rung, dataset and features."""
    return {
        (row["model"], row["dataset"], row["features"]): PublishedScore(
            table=int(row["table"]),
            rung=row["model"],
            dataset=row["dataset"],
            features=row["features"],
            r2_percent=float(row["r2_percent"]),
            mse=float(row["mse"]),
            rmse=float(row["rmse"]),
        )
        for row in _rows("scores.csv")
    }


@cache
def published_hyperparameters() -> dict[tuple[str, str, str], float]:
    """Return Table 8: values by rung, hyperparameter and input.

    Hyperparameters are ``variance``, ``length_scale``, ``alpha``, ``slope_variance`` and
    ``noise_variance``; the input is empty where it belongs to none, and ``all`` for the one length
    scale of a kernel without ARD. Length scales are in GPy's convention.
    """
    return {
        (row["rung"], row["parameter"], row["input"]): float(row["value"])
        for row in _rows("hyperparameters.csv")
    }


@cache
def published_datasets() -> dict[str, PublishedDataset]:
    """Return Table 9 by dataset."""
    return {
        row["dataset"]: PublishedDataset(
            dataset=row["dataset"],
            features=row["features"],
            n=int(row["n"]),
            n_train=int(row["n_train"]) if row["n_train"] else None,
            ranges={
                name: (float(row[f"{name}_low"]), float(row[f"{name}_high"]))
                for name in RANGES
                if row[f"{name}_low"]
            },
        )
        for row in _rows("datasets.csv")
    }


def _rows(name: str) -> Iterator[dict[str, str]]:
    text = files("exposight.paper").joinpath("data", name).read_text(encoding="utf-8")
    yield from csv.DictReader(text.splitlines())
