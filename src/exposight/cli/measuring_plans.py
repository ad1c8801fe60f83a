"""Measuring plans that the command line is given, and those that it knows by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from exposight.cell import sensor_preset
from exposight.cli.facts import Recognised, fact
from exposight.cli.output import count, number, print_json, print_table
from exposight.errors import InputError, did_you_mean
from exposight.plans import PLAN_FORMAT, PLAN_SUFFIXES, PLANS, DepthPlane, read_plan, views
from exposight.twin.part import door_part

if TYPE_CHECKING:
    from exposight.plans import MeasuringPlan


def plan_from(name_or_path: str) -> MeasuringPlan:
    """Return the measuring plan that a preset's name or a file describes.

    Raises
    ------
    InputError
        If it is neither.
    FileError
        If the file is not a plan.
    """
    if name_or_path in PLANS:
        return PLANS[name_or_path]
    path = Path(name_or_path)
    if path.is_file() or path.suffix.lower() in PLAN_SUFFIXES:
        return read_plan(path)
    msg = (
        f"no measuring plan '{name_or_path}': expected a TOML or YAML file, or one of "
        f"{', '.join(PLANS)}{did_you_mean(name_or_path, PLANS)}"
    )
    raise InputError(msg)


def is_plan(path: Path) -> bool:
    """Tell whether a TOML or YAML file is meant as a measuring plan."""
    text = path.read_text(encoding="utf-8", errors="replace")
    # Nothing else has exposure times in groups: reading it tells that its first line is missing.
    return PLAN_FORMAT in text or "exposures_ms" in text


def recognise_plan(plan: MeasuringPlan, remark: str = "") -> Recognised:
    """Describe a measuring plan.

    Parameters
    ----------
    plan : MeasuringPlan
        The plan.
    remark : str
        Where it comes from, if not from a file.
    """
    positions = dict(zip((group.name for group in plan.groups), _positions(plan), strict=True))
    exposures = {group.name: group.exposures_ms for group in plan.groups}
    captures = sum(n * len(exposures[name]) for name, n in positions.items())
    per_group = ", ".join(f"{name} {count(n)}" for name, n in positions.items())
    # Which views see no feature depends on the part, which is not known here.
    at_most = "at most " if plan.blind_views == "skip" else ""
    return Recognised(
        kind="measuring plan",
        remark=remark,
        facts=(
            fact("name", plan.name),
            fact("sensor", plan.sensor),
            fact("side", plan.side),
            fact("lighting", plan.lighting),
            fact("features", plan.features, f"{len(plan.features)}: {', '.join(plan.features)}"),
            fact("reference", plan.reference),
            fact("views", positions, f"{at_most}{count(sum(positions.values()))}: {per_group}"),
            fact("blind views", plan.blind_views),
            fact(
                "exposures ms",
                exposures,
                "\n".join(
                    f"{name} {', '.join(f'{t:g}' for t in times)}"
                    for name, times in exposures.items()
                ),
            ),
            fact("captures", captures, at_most + count(captures)),
            fact("seed", plan.seed),
            fact("built-in door", _on_the_door(plan)),
        ),
    )


def _on_the_door(plan: MeasuringPlan) -> str:
    """Say whether the plan can be carried out on the part that is built in."""
    try:
        planned = views(plan, door_part(), sensor_preset(plan.sensor))
    except InputError as error:
        return f"cannot be measured by this plan: {error}"
    return f"{count(len(planned))} views see features"


def _positions(plan: MeasuringPlan) -> list[int]:
    """Return how many positions each group of views has."""
    return [
        len(group.x_mm) * len(group.y_mm) if isinstance(group, DepthPlane) else group.count
        for group in plan.groups
    ]


def print_plans(*, as_json: bool) -> None:
    """Print the plans that have a name, or a JSON document of them."""
    documents: list[dict[str, object]] = []
    rows = []
    for plan in PLANS.values():
        positions = _positions(plan)
        captures = sum(
            n * len(group.exposures_ms) for n, group in zip(positions, plan.groups, strict=True)
        )
        exposures = [t for group in plan.groups for t in group.exposures_ms]
        documents.append(
            {
                "plan": plan.name,
                "sensor": plan.sensor,
                "side": plan.side,
                "lighting": plan.lighting,
                "features": plan.features,
                "positions": sum(positions),
                "captures": captures,
                "exposures_ms": {"min": min(exposures), "max": max(exposures)},
            }
        )
        rows.append(
            (
                plan.name,
                plan.sensor,
                f"{plan.side} {plan.lighting}",
                str(len(plan.features)),
                count(sum(positions)),
                count(captures),
                f"{number(min(exposures))}–{number(max(exposures))}",
            )
        )
    if as_json:
        print_json({"plans": documents})
        return
    print_table(
        ("plan", "sensor", "side,\nlighting", "features", "views", "captures", "exposure\nms"),
        rows,
        title="Measuring plans (the few views that see none of their features are left out)",
        words=("side,\nlighting",),
    )
