"""Which captures to take, as an integer program over the captures of many views.

A column is a capture: a view at an exposure time, with the features that it serves. Some features
are served by several captures of one view together only; such a group is a column of its own, which
is there once all its captures are. With x_c for captures, y_v for views that are visited, z_fv for
features served in a view and w_g for groups, the least cost is that of

    min  Σ cost_c x_c + Σ move_v y_v
    s.t. Σ_v z_fv ≥ 1,  z_fv ≤ Σ_c∋f x_c + Σ_g∋f w_g,  z_fv ≤ y_v,  x_c ≤ y_v,  w_g ≤ x_c (c in g).

This is the strong form of facility location: where windows are intervals, each view's block is an
interval matrix, and the relaxation's bound is the best that columns for whole views could give. x
and y are integers; z follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

BoolArray: TypeAlias = NDArray[np.bool_]
FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Program:
    """n features, c captures of v views, and g groups of captures.

    Parameters
    ----------
    covers : (n, c + g) sparse array
        1 where a capture or group serves a feature. Captures of a view stand together.
    view : (c + g,) ndarray
        View of each.
    cost : (c,) ndarray
        Of each capture.
    groups : tuple of tuple of int
        Captures of each group.
    move : (v,) ndarray
        Cost of visiting each view.
    least, most : int
        A view that is captured is captured so many times.
    """

    covers: sparse.csc_array
    view: IntArray
    cost: FloatArray
    move: FloatArray
    groups: tuple[tuple[int, ...], ...] = ()
    least: int = 1
    most: int | None = None

    @property
    def n_captures(self) -> int:
        """Number of captures to choose from."""
        return len(self.cost)

    @cached_property
    def members(self) -> sparse.csr_array:
        """1 where a capture belongs to a group, (g, c)."""
        rows = [row for row, group in enumerate(self.groups) for _ in group]
        columns = [each for group in self.groups for each in group]
        shape = (len(self.groups), self.n_captures)
        return sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=shape)

    def counts(self, taken: BoolArray) -> IntArray:
        """Return how many captures each view takes, (v,)."""
        return np.bincount(self.view[: self.n_captures][taken], minlength=len(self.move))

    def served(self, taken: BoolArray) -> BoolArray:
        """Return which features some captures serve, alone or together, (n,)."""
        sizes = np.array([len(group) for group in self.groups], dtype=np.int64)
        whole = np.asarray(self.members @ taken.astype(float)) >= sizes - 0.5
        out: BoolArray = (
            np.asarray(self.covers @ np.concatenate([taken, whole]).astype(float)) > 0.5
        )
        return out

    def value(self, taken: BoolArray) -> float:
        """Return the cost of some captures, views included."""
        return float(self.cost[taken].sum() + self.move[self.counts(taken) > 0].sum())

    def keeps_limits(self, taken: BoolArray) -> bool:
        """Return whether no view is captured more or less often than allowed."""
        counts = self.counts(taken)
        counts = counts[counts > 0]
        most = np.inf if self.most is None else self.most
        return bool(((counts >= self.least) & (counts <= most)).all())

    def of_features(self, rows: IntArray) -> Program:
        """Return the program of some features, with all captures."""
        return replace(self, covers=sparse.csc_array(self.covers.tocsr()[rows]))

    def without_implied(self) -> Program:
        """Leave out features that are served whenever another one is: exact, if all are served."""
        covers = self.covers.tocsr()
        sizes = np.diff(covers.indptr)
        overlap = (covers @ covers.T).tocoo()
        one, other = overlap.row, overlap.col
        implied = (overlap.data >= sizes[one] - 0.5) & (one != other)
        implied &= (sizes[other] > sizes[one]) | (other > one)  # of equal ones the first stays
        kept = np.ones(len(sizes), dtype=np.bool_)
        kept[other[implied]] = False
        return self.of_features(np.flatnonzero(kept))

    def components(self) -> list[tuple[IntArray, IntArray]]:
        """Return features and captures of the parts that have nothing in common.

        Captures are joined by their views, whose cost they share.
        """
        n, coo = self.covers.shape[0], self.covers.tocoo()
        n_nodes = n + len(self.move)
        links = sparse.coo_array(
            (np.ones(len(coo.row)), (coo.row, n + self.view[coo.col])), shape=(n_nodes, n_nodes)
        )
        _, label = connected_components(links, directed=False)
        captures = label[n + self.view[: self.n_captures]]
        return [
            (np.flatnonzero(label[:n] == each), np.flatnonzero(captures == each))
            for each in np.unique(label[:n])
        ]

    def part(self, features: IntArray, captures: IntArray) -> Program:
        """Return the program of a component; captures keep their order."""
        place = {int(capture): i for i, capture in enumerate(captures)}
        kept = [g for g, group in enumerate(self.groups) if group[0] in place]
        columns = np.concatenate([captures, self.n_captures + np.array(kept, dtype=np.int64)])
        return replace(
            self,
            covers=sparse.csc_array(self.covers.tocsr()[features].tocsc()[:, columns]),
            view=self.view[columns],
            cost=self.cost[captures],
            groups=tuple(tuple(place[each] for each in self.groups[g]) for g in kept),
        )

    # -- as matrices ----------------------------------------------------------------------------

    def linear(self, weights: FloatArray | None = None, budget: float | None = None) -> Linear:
        """Return the program as matrices: least cost, or most features within a budget.

        Parameters
        ----------
        weights : (n,) ndarray, optional
            What each feature is worth; with a budget.
        budget : float, optional
            The captures and views cost at most so much.
        """
        n, columns = self.covers.shape
        c, v = self.n_captures, len(self.move)
        g = columns - c
        visits = bool(self.move.any())
        coo = self.covers.tocoo()
        pairs, pair_of = np.unique(coo.row * v + self.view[coo.col], return_inverse=True)
        p = len(pairs) if visits else 0
        u = n if budget is not None else 0
        with_views = visits or self.least > 1
        width = c + g + v + p + u  # x, w, y, z, u
        y, z, of_u = c + g, c + g + v, c + g + v + p
        blocks: list[sparse.coo_array] = []
        low: list[FloatArray] = []

        def rows(count: int, least: float | FloatArray, *entries: _Entries) -> None:
            """Add rows Σ value · variable ≥ least."""
            if count:
                row, column, value = (
                    np.concatenate([np.broadcast_to(e[i], np.shape(e[0])) for e in entries])
                    for i in range(3)
                )
                blocks.append(sparse.coo_array((value, (row, column)), shape=(count, width)))
                low.append(np.broadcast_to(np.asarray(least, dtype=np.float64), count))

        feature = np.arange(n)
        chosen = [(feature, of_u + feature, -1.0)] if u else []
        served = 0.0 if u else 1.0
        if visits:
            pair = np.arange(p)
            rows(n, served, (pairs // v, z + pair, 1.0), *chosen)
            rows(p, 0.0, (pair_of, coo.col, 1.0), (pair, z + pair, -1.0))
            rows(p, 0.0, (pair, y + pairs % v, 1.0), (pair, z + pair, -1.0))
        else:
            rows(n, served, (coo.row, coo.col, 1.0), *chosen)
        capture, views = np.arange(c), self.view[:c]
        if with_views:
            rows(c, 0.0, (capture, y + views, 1.0), (capture, capture, -1.0))
        if self.least > 1:
            rows(
                v, 0.0, (views, capture, 1.0), (np.arange(v), y + np.arange(v), -float(self.least))
            )
        if self.most is not None:
            rows(v, -float(self.most), (views, capture, -1.0))
        if g:
            links = self.members.tocoo()
            link = np.arange(len(links.row))
            rows(len(link), 0.0, (link, links.col, 1.0), (link, c + links.row, -1.0))
        price = np.concatenate([self.cost, np.zeros(g), self.move, np.zeros(p + u)])
        if budget is not None:
            rows(
                1, -budget, (np.zeros(c + g + v, dtype=np.int64), np.arange(c + g + v), -price[:z])
            )
            objective = np.concatenate([np.zeros(width - u), -np.asarray(weights)])
        else:
            objective = price
        upper = np.ones(width)
        if not with_views:
            upper[y:z] = 0.0
        whole = np.zeros(width)
        whole[:c] = whole[y:z] = 1.0
        return Linear(
            objective=objective,
            matrix=sparse.csr_array(sparse.vstack(blocks)),
            low=np.concatenate(low),
            upper=upper,
            whole=whole,
            n_captures=c,
        )


_Entries: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int64], "float | FloatArray"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """min objective·x, subject to matrix·x ≥ low, 0 ≤ x ≤ upper, some of x whole numbers.

    The first `n_captures` variables are captures.
    """

    objective: FloatArray
    matrix: sparse.csr_array
    low: FloatArray
    upper: FloatArray
    whole: FloatArray
    n_captures: int

    def at_most(self, cutoff: float) -> Linear:
        """Return the program of the solutions that cost no more than a cut-off."""
        row = sparse.csr_array(-self.objective[None, :])
        return replace(
            self,
            matrix=sparse.csr_array(sparse.vstack([self.matrix, row])),
            low=np.append(self.low, -cutoff),
        )


def useful_settings(
    serves: BoolArray, cost: FloatArray, *, keep: Sequence[int] = (), least: int = 1
) -> IntArray:
    """Return the captures of one view that an optimal cover may need.

    A capture that serves no more than another one, which costs no more, is left out; so of all
    exposure times with the same features the cheapest stays. Exact.

    Parameters
    ----------
    serves : (n, m) ndarray of bool
        Which features each capture serves.
    cost : (m,) ndarray
        Ascending.
    keep : sequence of int
        Captures that stay, as groups need them.
    least : int
        At least so many stay.
    """
    sets = serves.astype(np.float32)
    size = sets.sum(axis=0)
    within = sets.T @ sets >= size[:, None] - 0.5  # that of the row is part of that of the column
    place = np.arange(len(cost))
    cheaper = cost[None, :] < cost[:, None]
    larger = size[None, :] > size[:, None]
    earlier = (size[None, :] == size[:, None]) & (place[None, :] < place[:, None])
    as_cheap = (cost[None, :] == cost[:, None]) & (larger | earlier)
    dominated = (within & (cheaper | as_cheap)).any(axis=1) | (size == 0)
    dominated[list(keep)] = False
    short = least - int(np.count_nonzero(~dominated))
    if short > 0:
        dominated[np.flatnonzero(dominated)[:short]] = False
    return np.flatnonzero(~dominated)
