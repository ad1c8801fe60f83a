"""Which observations train a model and which test it."""

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.errors import InputError, ObservationError
from exposight.statistics.vectors import FloatArray, as_floats

IndexArray: TypeAlias = NDArray[np.intp]
BoolArray: TypeAlias = NDArray[np.bool_]


class Split(NamedTuple):
    """Row numbers of the two sides of a split, each ascending.

    Attributes
    ----------
    train : (k,) int array
        Rows to learn from.
    test : (n − k,) int array
        The others.
    """

    train: IndexArray
    test: IndexArray


def random_split(n: int, share: float, rng: np.random.Generator) -> Split:
    """Split observations at random, as the paper does for training and validation.

    Near copies of one observation (the same feature and view at another exposure time) fall on
    both sides, so scores on the test side are optimistic; `split_by_group` keeps them together.

    Parameters
    ----------
    n : int
        Number of observations.
    share : float
        Of the training side, between 0 and 1; its size is rounded down, as the paper's 1936 of
        2421 are at 0.8.
    rng : numpy.random.Generator
        Draws the rows.

    Returns
    -------
    Split

    Raises
    ------
    InputError
        If the share is not between 0 and 1.
    ObservationError
        If a side would be empty.
    """
    size = _train_size(n, share, "observations")
    order = rng.permutation(n)
    return Split(train=np.sort(order[:size]), test=np.sort(order[size:]))


def split_by_group(groups: ArrayLike, share: float, rng: np.random.Generator) -> Split:
    """Split observations by whole groups, such as features or views.

    Parameters
    ----------
    groups : (n,) array
        The group of each observation: names or numbers.
    share : float
        Of the groups that train, between 0 and 1; their number is rounded down.
    rng : numpy.random.Generator
        Draws the groups.

    Returns
    -------
    Split

    Raises
    ------
    InputError
        If the share is not between 0 and 1.
    ObservationError
        If the groups are not a vector, or a side would be empty.
    """
    labels = np.asarray(groups)
    if labels.ndim != 1:
        msg = f"groups must hold one label for each observation, got shape {labels.shape}"
        raise ObservationError(msg)
    names, members = np.unique(labels, return_inverse=True)
    size = _train_size(len(names), share, "groups")
    trains = np.zeros(len(names), dtype=np.bool_)
    trains[rng.permutation(len(names))[:size]] = True
    return Split(train=np.flatnonzero(trains[members]), test=np.flatnonzero(~trains[members]))


def inside_box(train: ArrayLike, query: ArrayLike) -> BoolArray:
    """Which inputs lie inside the training inputs' range in every column.

    With the columns x, y, z, w, p this selects the interpolating test observations, marked
    "test,i" in the paper's tables.

    Parameters
    ----------
    train : (n, D) array
        Training inputs, each column in its own unit.
    query : (m, D) array
        Inputs to judge, same columns.

    Returns
    -------
    (m,) bool array
        True from the smallest to the largest training value, both included, in every column.

    Raises
    ------
    ObservationError
        If an array is not a finite matrix, their columns differ in number, or there is no
        training row.
    """
    known, asked = _check_matrix(train, "train"), _check_matrix(query, "query")
    if len(known) == 0 or known.shape[1] != asked.shape[1]:
        msg = (
            "train and query must have the same columns, and train at least one row, "
            f"got shapes {known.shape} and {asked.shape}"
        )
        raise ObservationError(msg)
    inside: BoolArray = np.all((asked >= known.min(axis=0)) & (asked <= known.max(axis=0)), axis=1)
    return inside


def _train_size(n: int, share: float, things: str) -> int:
    if not 0.0 < share < 1.0:
        msg = f"share must lie between 0 and 1, such as 0.8, got {share!r}"
        raise InputError(msg)
    # 0.29 * 100 is 28.999999999999996
    size = int(share * n + 1e-9)
    if not 0 < size < n:
        msg = f"a share of {share:g} of {n} {things} leaves a side empty; at least two are needed"
        raise ObservationError(msg)
    return size


def _check_matrix(values: ArrayLike, name: str) -> FloatArray:
    array = as_floats(values, name)
    if array.ndim != 2 or not np.isfinite(array).all():
        msg = f"{name} must be a finite matrix (rows, columns), got shape {array.shape}"
        raise ObservationError(msg)
    return array
