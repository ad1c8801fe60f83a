"""What ``exposight simulate`` tells of a plan that it carried out."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from shlex import quote
from typing import TYPE_CHECKING

from exposight.cli.output import (
    count,
    counted,
    note,
    number,
    percent,
    print_facts,
    print_line,
    print_table,
)
from exposight.twin.campaign import OBSERVATIONS_FILE

if TYPE_CHECKING:
    from pathlib import Path

    from exposight.observing import ObservationTable
    from exposight.plans import MeasuringPlan, PlannedView
    from exposight.twin.campaign import CellSettings


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulationRun:
    """A plan that was carried out."""

    plan: MeasuringPlan
    part: str
    planned: tuple[PlannedView, ...]
    settings: CellSettings
    before: int
    captures: int
    seconds: float
    output: Path

    def seen(self) -> dict[str, int]:
        """Return in how many views each feature can be seen."""
        counted = Counter(name for view in self.planned for name in view.visible)
        return {name: counted[name] for name in self.plan.features}

    def exposures_ms(self) -> tuple[float, float]:
        """Return the shortest and the longest exposure time in ms."""
        exposures = [t for view in self.planned for t in view.exposures_ms]
        return min(exposures), max(exposures)


def _size_bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _spell_size(size: int) -> str:
    """Spell a size on disk with three digits."""
    for unit, scale in (("GB", 1e9), ("MB", 1e6)):
        if size >= scale:
            return f"{number(size / scale, 3)} {unit}"
    return f"{number(size / 1e3, 3)} kB"


def run_document(run: SimulationRun, table: ObservationTable | None) -> dict[str, object]:
    """Return a run as a JSON document."""
    kinematic = sum(view.aligned_by == "kinematics" for view in run.planned)
    shortest, longest = run.exposures_ms()
    document: dict[str, object] = {
        "plan": run.plan.name,
        "sensor": run.plan.sensor,
        "part": run.part,
        "rings_only": run.settings.rings_only,
        "workers": _processes(run) if run.settings.cluster is None else None,
        "cluster": run.settings.cluster,
        "views": len(run.planned),
        "views_aligned_by_kinematics": kinematic,
        "views_of_feature": run.seen(),
        "captures": run.captures,
        "captures_before": run.before,
        "exposures_ms": {"min": shortest, "max": longest},
        "seconds": run.seconds,
    }
    if table is None:
        kept = {
            "clouds": run.settings.clouds,
            "raw_frames": run.settings.raw_frames,
            "bytes": _size_bytes(run.output),
            "campaign": run.output,
        }
        if not run.settings.clouds:
            kept["observations"] = run.output / OBSERVATIONS_FILE
        return {**document, **kept}
    return {
        **document,
        "rows": len(table),
        "visibility": table.counts(),
        "observations": run.output,
    }


def print_run(run: SimulationRun, table: ObservationTable | None) -> None:
    """Print a run, and what may come next."""
    seen = run.seen()
    taken = run.captures - run.before
    shortest, longest = run.exposures_ms()
    kinematic = sum(view.aligned_by == "kinematics" for view in run.planned)
    each = f", {number(run.seconds / taken, 3)} s each" if taken else ""
    found = sum(1 for n in seen.values() if n)
    facts = [
        (
            "captures",
            f"{count(run.captures)} {'of the rings' if run.settings.rings_only else 'whole frames'}"
            + (f", of which {count(run.before)} were there before" if run.before else ""),
        ),
        ("views", f"{count(len(run.planned))}, of which {count(kinematic)} aligned by kinematics"),
        (
            "features",
            f"{found} of {len(seen)} seen, {number(sum(seen.values()) / len(run.planned), 2)} a "
            "view on average",
        ),
        ("exposure times", f"{number(shortest)} to {number(longest)} ms"),
        ("time", f"{number(run.seconds, 3)} s{each}, by {_workers(run)}"),
    ]
    if table is None:
        size = _spell_size(_size_bytes(run.output))
        facts.append(("on disk", f"{size}: {_kept(run.settings)}"))
    print_facts(f"{run.plan.name}: part {run.part}, {run.plan.sensor}", facts)
    blind = [name for name, n in seen.items() if not n]
    if blind:
        note(f"no view sees {', '.join(blind)}")
    if table is None:
        print_line(f"wrote the campaign: {run.output}")
        following = f"observe {quote(str(run.output))}"
        if not run.settings.clouds:
            following = f"train {quote(str(run.output / OBSERVATIONS_FILE))}"
        print_line(f"next:               exposight {following}")
        return
    print_line("")
    print_table(
        ("features are", "rows", "share %"),
        (
            (reason, count(rows), percent(rows / len(table)))
            for reason, rows in table.counts().items()
        ),
    )
    print_line(f"wrote the observations: {run.output}")
    print_line(f"next:                   exposight train {quote(str(run.output))}")


def _workers(run: SimulationRun) -> str:
    if run.settings.cluster is not None:
        return f"the cluster at {run.settings.cluster}"
    return counted(_processes(run), "worker")


def _processes(run: SimulationRun) -> int:
    """Return how many processes worked: a view is done by one of them."""
    return min(run.settings.workers, max(1, len(run.planned)))


def _kept(settings: CellSettings) -> str:
    clouds = "clouds" if settings.clouds else f"{OBSERVATIONS_FILE}, no clouds"
    return f"images, {clouds}" + (", raw frames" if settings.raw_frames else "")
