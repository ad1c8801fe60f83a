"""Facts about a file: for people and for machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.cli.output import number
from exposight.quantities import quantity

if TYPE_CHECKING:
    from collections.abc import Iterable

    from exposight.cell import ActiveSensor
    from exposight.geometry import PinholeCamera


@dataclass(frozen=True, kw_only=True)
class Fact:
    """One thing known about a file.

    Parameters
    ----------
    name : str
        What it is called.
    value : object
        For machines: text, number, or lists of them.
    text : str
        For people, with its unit.
    """

    name: str
    value: object
    text: str


@dataclass(frozen=True, kw_only=True)
class Recognised:
    """What a file is.

    Parameters
    ----------
    kind : str
        One of a few fixed words, such as "model" or "point cloud".
    facts : tuple of Fact
        What is known about it.
    remark : str
        What people should know beside the kind.
    """

    kind: str
    facts: tuple[Fact, ...]
    remark: str = ""


def fact(name: str, value: object, text: str | None = None) -> Fact:
    """Return a fact whose text, if not given, is its value."""
    return Fact(name=name, value=value, text=str(value) if text is None else text)


def limits(values: Iterable[float]) -> list[float] | None:
    """Return the smallest and largest of the finite values; None where there is none."""
    known = [float(value) for value in values if np.isfinite(value)]
    return [min(known), max(known)] if known else None


def span(values: Iterable[float], unit: str) -> str:
    """Spell the range of the finite values with their unit."""
    known = limits(values)
    return "–" if known is None else f"{number(known[0])} … {number(known[1])} {unit}".rstrip()


def short_unit(variable: str) -> str:
    """Return the unit of one of the models' variables, empty for p_norm, which has none."""
    return quantity(variable).suffix


def camera_facts(name: str, camera: PinholeCamera) -> tuple[Fact, ...]:
    """Return a camera's or projector's intrinsic parameters."""
    lens = ", ".join(number(own, 3) for own in camera.distortion) or "none"
    return (
        fact(
            f"{name} size px",
            [camera.width, camera.height],
            f"{camera.width} × {camera.height}",
        ),
        fact(
            f"{name} focal px",
            [camera.fx, camera.fy],
            f"{number(camera.fx, 6)}, {number(camera.fy, 6)}",
        ),
        fact(
            f"{name} centre px",
            [camera.cx, camera.cy],
            f"{number(camera.cx, 6)}, {number(camera.cy, 6)}",
        ),
        fact(f"{name} distortion", list(camera.distortion), lens),
    )


def sensor_facts(sensor: ActiveSensor) -> tuple[Fact, ...]:
    """Return what is known about a sensor."""
    low, high, step = (
        sensor.exposure.min_ms,
        sensor.exposure.max_ms,
        sensor.exposure.increment_ms,
    )
    projector = sensor.projector
    tcp_mm = sensor.camera_from_tcp.translation_mm.tolist()
    return (
        fact("name", sensor.name),
        fact("cameras", len(sensor.cameras)),
        *camera_facts("camera", sensor.camera),
        fact(
            "projector",
            None if projector is None else [projector.width, projector.height],
            "not known" if projector is None else f"{projector.width} × {projector.height} px",
        ),
        fact("exposures ms", [low, high, step], f"{low:g} … {high:g} ms in steps of {step:g} ms"),
        fact(
            "working distance mm",
            list(sensor.working_distance_mm),
            span(sensor.working_distance_mm, "mm"),
        ),
        fact("tcp mm", tcp_mm, f"at {', '.join(map(number, tcp_mm))} mm in the camera's frame"),
    )
