"""``exposight demo``: the whole method once, on a recording."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from exposight.cli.output import (
    JsonOption,
    count,
    note,
    number,
    percent,
    print_json,
    print_line,
    print_table,
    progress_bars,
)
from exposight.demo import DATA_VARIABLE, DemoSettings, run_demo
from exposight.models import MODEL_SUFFIX, UNITS, model_named
from exposight.report import write_demo_report

if TYPE_CHECKING:
    from exposight.demo import DemoResult
    from exposight.models import Evaluation

_FULL = DemoSettings()
_QUICK_MODELS = ("q_k1", "q_k4", "e_k1", "e_k6")

_Data = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help=f"The skull recording, or the folder above it. Without: {DATA_VARIABLE}, then the "
        "usual places.",
    ),
]
_Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where everything is written.")
]
_Features = Annotated[
    int | None,
    typer.Option(
        min=4,
        show_default=False,
        help=f"Ring features to place, half of which train ({_FULL.features}, or 60 with --quick).",
    ),
]
_Seed = Annotated[int, typer.Option(min=0, help="Of places, split and restarts.")]
_Quick = Annotated[
    bool,
    typer.Option("--quick", help=f"Fewer features and exposures, only {', '.join(_QUICK_MODELS)}."),
]


def demo_command(
    data: _Data = None,
    output: _Output = Path("demo-output"),
    features: _Features = None,
    seed: _Seed = _FULL.seed,
    quick: _Quick = False,
    as_json: JsonOption = False,
) -> None:
    """Run the whole method once, on stripe images of a real object.

    Decodes a recorded skull, places ring features on it, emulates an exposure
    sweep, observes, trains on half of the features and predicts for the other
    half, and writes report.html, which opens without a network. Whatever is
    captured stays; run it again after an interruption and it goes on.

    For example:

      exposight demo --data ../shared/data/real/skull
    """
    settings = _settings(features, seed, quick=quick)
    with progress_bars(keep=True) as progress:
        result = run_demo(output, data, settings, progress)
        report = result.output / "report.html"
        progress("writing the report", 0, 1)
        write_demo_report(report, result)
        progress("writing the report", 1, 1)
    if as_json:
        print_json(_document(result, report))
    else:
        _print(result, report)


def _settings(features: int | None, seed: int, *, quick: bool) -> DemoSettings:
    if quick:
        return DemoSettings(
            features=features or 60,
            steps_per_decade=4,
            steps_each_way=3,
            seed=seed,
            restarts=1,
            models=tuple(map(model_named, _QUICK_MODELS)),
        )
    return DemoSettings(features=features or _FULL.features, seed=seed)


def _document(result: DemoResult, report: Path) -> dict[str, object]:
    return {
        "decoding": [
            {
                "title": check.title,
                "counts": asdict(check.counts),
                "common_points": check.agreement.common_points,
                "median_mm": check.agreement.median_mm,
                "p90_mm": check.agreement.p90_mm,
                "seconds": check.seconds,
            }
            for check in result.checks
        ],
        "features": result.settings.features,
        "exposures_ms": result.settings.exposures_ms(),
        "emulated": True,
        "observations": len(result.table),
        "unseen_rings_overlap": result.overlap,
        "visibility": result.table.counts(),
        "models": [
            {
                "model": own.model.specification.name,
                "target": own.model.specification.target,
                "unit": UNITS[own.model.specification.target],
                "known_features": asdict(own.known.score),
                "unseen_features": asdict(own.unseen.score),
                "seconds": own.seconds,
            }
            for own in result.results
        ],
        "output": result.output,
        "report": report,
    }


def _print(result: DemoResult, report: Path) -> None:
    print_line("")
    print_table(
        ("decoded", "points in\ncommon", "median\nmm", "90 %\nmm", "s"),
        (
            (
                check.title,
                count(check.agreement.common_points),
                number(check.agreement.median_mm, 3),
                number(check.agreement.p90_mm, 3),
                f"{check.seconds:.2f}",
            )
            for check in result.checks
        ),
        title="Distance to the authors' cloud, along the camera's rays",
    )
    print_line("")
    print_table(
        ("model", "predicts", "known\nR² %", "known\nRMSE", "unseen\nR² %", "unseen\nRMSE"),
        (
            (
                own.model.specification.name,
                own.model.specification.title,
                *_cells(own.known),
                *_cells(own.unseen),
            )
            for own in result.results
        ),
        title="Models, on the features that trained them and on features they never saw",
        words=("predicts",),
    )
    print_line("")
    note(
        "the exposure times are emulated: recorded grey values scaled, rounded and clipped, "
        "the recording counting as a nominal 10 ms"
    )
    note(
        f"{percent(result.overlap)} % of the unseen features' ring pixels also lie in the ring of "
        "a feature that trained"
    )
    best = result.output / "models" / f"{result.results[0].model.specification.name}{MODEL_SUFFIX}"
    observations = result.output / "observations.csv"
    program = sys.argv[0] if "exposight" in sys.argv[0] else "exposight"
    print_line(f"report:       {report}")
    print_line(f"observations: {observations}")
    print_line(f"campaign:     {result.output / 'campaign'}")
    print_line(f"next:         {program} info {best}")


def _cells(evaluation: Evaluation) -> tuple[str, str]:
    quality = evaluation.specification.target == "p_norm"
    scale, unit = (100.0, "%") if quality else (1.0, "ms")  # percent of full scale, as the paper
    score = evaluation.score
    return f"{score.r2_percent:.1f}", f"{number(scale * score.rmse, 3)} {unit}"
