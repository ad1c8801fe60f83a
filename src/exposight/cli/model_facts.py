"""What commands tell about trained models: what was found, and how what is left out is missed."""

import re
from dataclasses import asdict
from typing import Any, Final, Literal

import numpy as np

from exposight.cli.result import Fact, fact
from exposight.models import Predictor, RadianceModel, WindowModel
from exposight.observing import ObservationTable
from exposight.tables import Column, Table, counted, number

_GROUPS: Final[tuple[Literal["feature", "view"], ...]] = ("feature", "view")

_IMAGES = {
    "stripe": "one stripe image a capture",
    "stripes-mean": "the mean of the finest stripes' images",
    "texture": "a texture image",
}
"""In words, what a capture's image is (`exposight.cell.BrightnessSource`)."""


def model_facts(
    model: WindowModel | RadianceModel, table: ObservationTable | None = None
) -> list[Fact]:
    """Return what a default model found of sensor and surface, with units.

    With its training table, what images the brightness was read from, too.
    """
    radiance = model.radiance if isinstance(model, WindowModel) else model
    origin = radiance.origin
    images = []
    if table is not None:
        images = table.measured().frame["brightness_source"].drop_nulls().unique().sort().to_list()
    black = f"black level {number(radiance.black_level, 3)}" + (
        "" if radiance.black_level_known else ", assumed"
    )
    source = f" of {' and of '.join(_IMAGES.get(each, each) for each in images)}" if images else ""
    formula, (feature, view) = radiance.learnt.formula, radiance.learnt.widening
    facts = [
        fact("finish", origin.finish, origin.finish or "not said"),
        fact("part", origin.part, origin.part or "not said"),
        fact("tcp", origin.tcp, origin.tcp and f"{origin.tcp} (mm, °) in the camera's frame"),
        fact("rings", radiance.n_observations, f"{radiance.n_observations} of features in views"),
        fact(
            "brightness",
            {"column": radiance.brightness, "images": images, "black_level": radiance.black_level},
            f"{radiance.brightness}{source}; {black} grey levels",
        ),
    ]
    if isinstance(model, WindowModel) and model.target == "p_norm":
        low, high = model.limits
        facts.append(
            fact(
                "limits",
                {"modulation": low, "above_black": high},
                f"points from {number(low, 3)} grey levels of modulation on, up to "
                f"{number(high, 3)} grey levels above black in the brightest frame"
                if radiance.brightness != "i_avg"
                else f"points between {number(low, 3)} and {number(high, 3)} grey levels of i_avg "
                "above black",
            )
        )
    if formula.kind != "none":
        text = f"ln of specular over diffuse {number(formula.log_ratio, 3)}, roughness "
        facts.append(
            fact(
                "lobe",
                {"log_ratio": formula.log_ratio, "roughness": formula.roughness},
                f"{text}{number(formula.roughness, 3)}; light comes from the {formula.kind}",
            )
        )
    facts.append(
        fact(
            "widening",
            {"unseen_feature": feature, "unseen_view": view},
            f"bands of unseen features × {number(feature, 3)}, of unseen views × "
            f"{number(view, 3)} (Student's t times conformal factor)",
        )
    )
    return facts


def left_out_table(model: RadianceModel) -> Table:
    """Return how well a model predicts exposure times of features, and of views, left out.

    In closed form, from its training data alone (`LogRadiance.left_out`).
    """
    learnt, rows = model.learnt, []
    for group, names, factor in zip(
        _GROUPS, (learnt.features, learnt.views), learnt.widening, strict=True
    ):
        error, std = learnt.left_out(group)
        score = np.abs(error) / std
        rows.append(
            {
                "left_out": f"one of {counted(len(names), group)}",
                "rings": len(error),
                "median_error": float(np.median(np.abs(np.expm1(error)))),
                "rmse": float(np.sqrt(np.mean(np.expm1(error) ** 2))),
                "coverage_1sigma": float(np.mean(score <= 1.0)),
                "coverage_2sigma": float(np.mean(score <= 2.0)),
                "widening": factor,
            }
        )
    percent: dict[str, Any] = {"digits": 3, "scale": 100.0}
    columns = (
        Column(name="left_out"),
        Column(name="rings"),
        Column(name="median_error", label="median\nerror %", **percent),
        Column(name="rmse", label="RMSE\n%", **percent),
        Column(name="coverage_1sigma", label="in\n±1σ %", **percent),
        Column(name="coverage_2sigma", label="in\n±2σ %", **percent),
        Column(name="widening", label="bands\nwidened ×", digits=3),
    )
    title = "exposure: relative errors of features and views left out, one after the other"
    return Table.of("left_out", rows, columns, title=title)


def hyperparameter_table(model: Predictor) -> Table:
    """Return a model's hyperparameters with what they act on and their units."""
    return Table.of(
        f"hyperparameters_of_{model.name}",
        (
            {
                "hyperparameter": re.sub(r"[._]|\[.*", " ", parameter.name).strip(),
                **asdict(parameter),
            }
            for parameter in model.hyperparameters()
        ),
        (
            Column(name="hyperparameter", wraps=True),
            Column(name="inputs", label="acts on", wraps=True),
            *(Column(name=name) for name in ("value", "unit", "remark")),
        ),
        title=model.name,
    )
