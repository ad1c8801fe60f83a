"""An order of views with short ways between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise

from exposight.geometry import RigidTransform


def visiting_order(poses: Mapping[str, RigidTransform]) -> list[str]:
    """Return views in an order with short ways between them: the nearest next, then 2-opt.

    The first one stays the first.

    Parameters
    ----------
    poses : mapping of str to RigidTransform
        camera_from_part of each view.
    """
    places = {name: pose.inverse().translation_mm for name, pose in poses.items()}

    def way(one: str, other: str) -> float:
        offset = places[one] - places[other]
        return float((offset @ offset) ** 0.5)

    def length(order: Sequence[str]) -> float:
        return sum(way(one, other) for one, other in pairwise(order))

    order, left = list(places)[:1], list(places)[1:]
    while left:
        order.append(min(left, key=lambda name: way(order[-1], name)))
        left.remove(order[-1])
    better = True
    while better:
        better = False
        for i, j in combinations(range(1, len(order)), 2):
            turned = [*order[:i], *order[i : j + 1][::-1], *order[j + 1 :]]
            if length(turned) < length(order) - 1e-6:
                order, better = turned, True
    return order
