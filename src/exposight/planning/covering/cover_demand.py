"""From chances to a cover program: what each feature asks, and which captures give it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from exposight.errors import InputError
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.covering.cover_program import Program, useful_settings
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits
from exposight.planning.outlook import WORTH_TRYING

BoolArray: TypeAlias = NDArray[np.bool_]
FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]

_DUST = 1e-9

_BEST_EFFORT = 0.95
"""A feature that cannot reach the confidence is served by what gives so much of its best chance."""

_MOST_TOGETHER = 4
"""Captures of one view that together may bring a feature to the confidence."""

_MOST_GROUPS = 200
"""Groups of captures of one view; those that serve most features."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Demand:
    """What is asked of captures, as a program.

    Parameters
    ----------
    views : tuple of CaptureChances
        The views.
    features : tuple of str
        All their features, in the order in which they come.
    targets : (n,) ndarray
        Chance to plan for each feature; 0 where it is not worth trying.
    asked : (k,) ndarray of int
        Those worth trying, which are the program's features.
    program : Program
        Its costs are captures or milliseconds.
    setting : (c,) ndarray of int
        Place of each of the program's captures among its view's settings.
    """

    views: tuple[CaptureChances, ...]
    features: tuple[str, ...]
    targets: FloatArray
    asked: IntArray
    program: Program
    setting: IntArray

    def places(self, taken: BoolArray) -> list[tuple[int, ...]]:
        """Return the places of the settings that each view takes, ascending."""
        out: list[list[int]] = [[] for _ in self.views]
        for column in np.flatnonzero(taken):
            out[self.program.view[column]].append(int(self.setting[column]))
        return [tuple(sorted(each)) for each in out]


def demand_of(
    views: Sequence[CaptureChances],
    limits: ExposureLimits,
    costs: CaptureCosts,
    *,
    by_time: bool,
    confidence: float,
    moves: bool,
) -> Demand:
    """Return what is asked of the captures of some views.

    A feature asks for the confidence, of one capture; where none gives it, of several captures of
    one view, whose joint chance is exact; where these do not either, for nearly the best that one
    capture gives, if that is more likely than not. Where a forecast may not be relied on, it counts
    only for features that no view has a better one of.

    Raises
    ------
    InputError
        If there is no feature, or names are there twice.
    """
    features = _names(views)
    row = {name: i for i, name in enumerate(features)}
    rows = [np.array([row[name] for name in view.features], dtype=np.int64) for view in views]
    allowed = [np.array([limits.allows(ms) for ms in view.settings_ms]) for view in views]
    chances = [np.where(able, view.chance, 0.0) for view, able in zip(views, allowed, strict=True)]
    best: FloatArray = np.zeros(len(features))
    relied: FloatArray = np.zeros(len(features))
    for view, at, chance in zip(views, rows, chances, strict=True):
        highest = chance.max(axis=1, initial=0.0)
        sure = np.array([not reason for reason in view.reasons], dtype=np.bool_)
        best[at] = np.maximum(best[at], highest)
        relied[at] = np.maximum(relied[at], np.where(sure, highest, 0.0))
    trusted = relied >= WORTH_TRYING
    best = np.where(trusted, relied, best)
    usable = [
        ~trusted[at] | np.array([not reason for reason in view.reasons], dtype=np.bool_)
        for view, at in zip(views, rows, strict=True)
    ]
    targets = np.where(best >= confidence - _DUST, confidence, 0.0)
    most = min(limits.most_per_view or _MOST_TOGETHER, _MOST_TOGETHER)
    groups: list[dict[tuple[int, ...], BoolArray]] = []
    for view, at, chance, use in zip(views, rows, chances, usable, strict=True):
        short = use & (best[at] < confidence - _DUST)
        price = np.array([costs.capture_ms(ms) for ms in view.settings_ms])
        groups.append(_groups(view, chance, price, short, confidence, most))
        for served in groups[-1].values():
            targets[at[served]] = confidence
    second_best = np.where(best >= WORTH_TRYING, _BEST_EFFORT * best, 0.0)
    alone = best >= confidence - _DUST
    targets = np.where(targets > 0.0, targets, np.minimum(second_best, confidence))
    together = (targets >= confidence) & ~alone
    asked = np.flatnonzero(targets > 0.0)
    place_of = np.full(len(features), -1)
    place_of[asked] = np.arange(len(asked))
    columns: list[BoolArray] = []
    group_columns: list[BoolArray] = []
    settings, view_of, group_view, members, price_of = [], [], [], [], []
    n_columns = 0
    for v, (view, at, chance, use) in enumerate(zip(views, rows, chances, usable, strict=True)):
        kept = np.flatnonzero((targets[at] > 0.0) & use)
        serves = np.zeros((len(asked), chance.shape[1]), dtype=np.bool_)
        single = kept[~together[at[kept]]]
        serves[place_of[at[single]]] = chance[single] >= targets[at[single], None] - _DUST
        price = np.array(
            [costs.capture_ms(ms) if by_time else 1.0 for ms in view.settings_ms], dtype=np.float64
        )
        needed = sorted({place for group in groups[v] for place in group})
        useful = useful_settings(serves, price, keep=needed, least=limits.least_per_view)
        useful = useful[allowed[v][useful]]
        place = {int(setting): n_columns + i for i, setting in enumerate(useful)}
        for group, served in groups[v].items():
            column = np.zeros(len(asked), dtype=np.bool_)
            column[place_of[at[served & together[at]]]] = True
            if column.any():
                group_columns.append(column)
                group_view.append(v)
                members.append(tuple(place[each] for each in group))
        columns.append(serves[:, useful])
        settings.append(useful)
        view_of.append(np.full(len(useful), v))
        price_of.append(price[useful])
        n_columns += len(useful)
    covers = np.concatenate([*columns, *(each[:, None] for each in group_columns)], axis=1)
    program = Program(
        covers=sparse.csc_array(covers.astype(np.float64)),
        view=np.concatenate([*view_of, np.array(group_view, dtype=np.int64)]).astype(np.int64),
        cost=np.concatenate(price_of),
        move=np.full(len(views), costs.move_ms if by_time and moves else 0.0),
        groups=tuple(members),
        least=limits.least_per_view,
        most=limits.most_per_view,
    )
    return Demand(
        views=tuple(views),
        features=features,
        targets=targets,
        asked=asked,
        program=program,
        setting=np.concatenate(settings),
    )


def _names(views: Sequence[CaptureChances]) -> tuple[str, ...]:
    for kind, names in (
        ("view", [view.view for view in views]),
        *((f"feature of view {view.view!r}", list(view.features)) for view in views),
    ):
        if twice := sorted({name for name in names if names.count(name) > 1}):
            msg = f"{kind}: the name {twice[0]!r} is there twice; give each its own"
            raise InputError(msg)
    features = tuple(dict.fromkeys(name for view in views for name in view.features))
    if not features:
        msg = (
            "no view sees a feature, so there is nothing to plan: check poses, and on which side "
            "the features are"
        )
        raise InputError(msg)
    return features


def _groups(
    view: CaptureChances,
    chance: FloatArray,
    price: FloatArray,
    short: BoolArray,
    confidence: float,
    most: int,
) -> dict[tuple[int, ...], BoolArray]:
    """Return captures of one view that together serve features which none serves alone.

    Pairs, of those with the same features the cheapest; and where no pair is enough, the captures
    that a greedy choice takes.

    Returns
    -------
    dict
        Places of the captures, and which of the view's features they serve, (n,).
    """
    out: dict[tuple[int, ...], BoolArray] = {}
    possible = short & (view.any_of(range(len(view.settings_ms))) >= confidence - _DUST)
    if not possible.any() or most < 2:
        return out
    at = np.flatnonzero(possible)
    able = np.flatnonzero(chance.max(axis=0) > 0.0)
    pairs = np.array(list(combinations(able.tolist(), 2)), dtype=np.int64).reshape(-1, 2)
    joint = chance[at][:, pairs[:, 0]] + view.gain[at][:, pairs[:, 0], pairs[:, 1]]
    reached = joint >= confidence - _DUST
    useful = np.flatnonzero(reached.any(axis=0))
    useful = useful[np.lexsort((price[pairs[useful]].sum(axis=1), -reached[:, useful].sum(axis=0)))]
    _, first = np.unique(reached[:, useful], axis=1, return_index=True)
    for which in np.sort(first)[:_MOST_GROUPS]:
        served = np.zeros(len(short), dtype=np.bool_)
        served[at[reached[:, useful[which]]]] = True
        out[tuple(pairs[useful[which]].tolist())] = served
    for i in at[~reached.any(axis=1)]:
        group: tuple[int, ...] = ()
        while len(group) < most:
            gains = [view.any_of((*group, place))[i] for place in able]
            group = tuple(sorted({*group, int(able[int(np.argmax(gains))])}))
            if max(gains) >= confidence - _DUST:
                out[group] = view.any_of(group) >= confidence - _DUST
                out[group] &= possible
                break
    return out
