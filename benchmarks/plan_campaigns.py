"""Sweeps over exposure time by which strategies are judged: every outcome is known.

Views and features are none that models have learnt from. All 30 holes on the door's inside are
looked at, at 33 whole milliseconds from 2 to 700. What was simulated is kept as
`benchmarks.models_campaigns` keeps it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Final

from benchmarks.measuring import say
from benchmarks.models_campaigns import (
    CONDITIONS,
    SEEDS,
    observed,
    training_plan,
)
from benchmarks.relit_cell import ScatterCell, TwoLobesCell
from exposight.cell import Capture
from exposight.geometry import RigidTransform
from exposight.observing import ObservationTable
from exposight.plans import MeasuringPlan, plan_preset
from exposight.twin import SimulatedCell
from exposight.twin.light import trace_view
from exposight.twin.sensors import StripeSensor, ring_boxes
from exposight.twin.sensors.stripe_light import stripe_light
from exposight.twin.simulated_cell import scene_at

_PLAN: Final = plan_preset("sweep")
FEATURES: Final = _PLAN.features
TIMES_MS: Final = _PLAN.random[0].exposures_ms
_SWEEP_SEEDS = 200


class LampCell(SimulatedCell):
    """A simulated cell whose projector has another power than its models learnt."""

    power: ClassVar[float] = 1.0

    def description(self) -> dict[str, object]:
        """Return what decides the captures (`SimulatedCell.description`)."""
        return {**super().description(), "lamp": self.power}

    def _look(self, true: RigidTransform, reported: RigidTransform) -> Callable[..., Capture]:
        model = self._model
        if not isinstance(model, StripeSensor) or self._features is None:
            msg = "only stripes round features can be lit by another lamp"
            raise TypeError(msg)
        part = replace(self.part, features=tuple(map(self.part.feature, self._features)))
        boxes = ring_boxes(part, self.sensor, reported)
        view = trace_view(self._tracer, self.sensor, true, model=model.light, boxes=boxes)
        tiles = tuple(
            replace(tile, direct=tile.direct * self.power, indirect=tile.indirect * self.power)
            for tile in view.tiles
        )
        return partial(model.capture, stripe_light(replace(view, tiles=tiles), model.patterns))

    @property
    def _tracer(self) -> Any:
        from exposight.twin.simulated_cell import _tracer

        return _tracer(self.settings.scene, self.settings.finishes)


class DimLampCell(LampCell):
    """An aged lamp."""

    power = 0.55


class BrightLampCell(LampCell):
    """A new lamp."""

    power = 1.8


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Views of a cell at all exposure times.

    Parameters
    ----------
    name : str
    views : int
        Random views.
    settings : mapping of str to object
        Of the simulated cell.
    cell : type
        The cell.
    """

    name: str
    views: int
    settings: Mapping[str, Any] = field(default_factory=dict)
    cell: type[SimulatedCell] = SimulatedCell


SWEEPS: Final = (
    Sweep(name="bare", views=30),
    Sweep(name="lamp_dim", views=14, cell=DimLampCell),
    Sweep(name="lamp_bright", views=14, cell=BrightLampCell),
    Sweep(name="primer", views=8, settings={"finish": "primer"}),
    Sweep(name="paint", views=8, settings={"finish": "paint"}),
    Sweep(name="brushed", views=8, settings={"finish": "brushed"}),
    Sweep(name="two_lobes", views=8, cell=TwoLobesCell),
    Sweep(name="foreign_surface", views=8, cell=ScatterCell),
)
"""Models are trained on bare sheet under the lamp's nominal power: the others are never trained.
The last two reflect as no formula of the software says."""


def sweep_plan(views: int, seed: int) -> MeasuringPlan:
    """Return random views of all features, none of which a model has learnt from."""
    random = (replace(_PLAN.random[0], count=views),)
    return replace(_PLAN, random=random, seed=_SWEEP_SEEDS + seed)


def sweep_of(sweep: Sweep, seed: int) -> ObservationTable:
    """Return a sweep's observations, simulated where they are not kept."""
    plan = sweep_plan(sweep.views, seed)
    cell = sweep.cell.for_plan(plan, rings_only=True, **sweep.settings)
    return observed(f"sweep-{sweep.name}-{seed}", plan, cell)


def training_table(seed: int) -> ObservationTable:
    """Return the observations of nine holes from which models are trained."""
    (bare,) = (each for each in CONDITIONS if each.name == "bare")
    plan = training_plan(bare, seed)
    return observed(f"bare-train-{plan.seed}", plan, SimulatedCell.for_plan(plan, rings_only=True))


if __name__ == "__main__":
    missing = set(FEATURES) - {feature.name for feature in scene_at(None).part.features}
    assert not missing, missing
    for number in SEEDS[: int(sys.argv[1]) if len(sys.argv) > 1 else None]:
        for each in SWEEPS:
            say(f"{each.name}, seed {number}: {len(sweep_of(each, number))} rows")
