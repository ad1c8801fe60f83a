"""``exposight demo``: the whole method once, on the simulated cell or on a recording."""

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
from exposight.demo import (
    EXPOSURE_MODEL,
    QUALITY_MODEL,
    DoorSettings,
    SkullSettings,
    run_door,
    run_skull,
)
from exposight.models import MODEL_SUFFIX, model_named
from exposight.plans import PLANS
from exposight.report import write_report
from exposight.report.door import door_report
from exposight.report.skull import skull_report

if TYPE_CHECKING:
    from exposight.demo import DemoResult, DoorResult, SkullResult
    from exposight.models import Evaluation

_FULL = SkullSettings()
_QUICK_MODELS = ("q_k1", QUALITY_MODEL, "e_k1", EXPOSURE_MODEL)
_QUICK_PLAN = "small"

_Data = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Run on the skull recording in this folder, or in the folder below it, instead.",
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
        help="With --data: ring features to place, half of which train "
        f"({_FULL.features}, or 60 with --quick).",
    ),
]
_Seed = Annotated[int, typer.Option(min=0, help="Of everything random.")]
_Quick = Annotated[
    bool,
    typer.Option(
        "--quick",
        help=f"Fewer views (plan {_QUICK_PLAN!r}), or with --data fewer features and exposures; "
        f"only {', '.join(_QUICK_MODELS)}.",
    ),
]


def demo_command(
    data: _Data = None,
    output: _Output = Path("demo-output"),
    features: _Features = None,
    seed: _Seed = _FULL.seed,
    quick: _Quick = False,
    as_json: JsonOption = False,
) -> None:
    """Run the whole method once, on a simulated cell or a recording.

    Without --data: a door of bare sheet metal is measured in a simulated cell,
    models learn from some of its features and are judged by others. Then they
    forecast a new view and choose its exposure time; the view is taken, and
    held against the forecast. The numbers are the simulated cell's.

    With --data: a recorded skull is decoded, ring features are placed on it,
    an exposure sweep is emulated, and half of the features judge what was
    learnt from the other half.

    Either writes report.html, which opens without a network. Whatever is
    captured stays; run it again after an interruption and it goes on.

    For example:

      exposight demo

      exposight demo --data ../shared/data/real/skull
    """
    if data is None and features is not None:
        msg = "--features is for the skull recording; give its folder with --data, or leave it out"
        raise typer.BadParameter(msg)
    if data is None:
        _demo_on_door(output, _door_settings(seed, quick=quick), as_json=as_json)
    else:
        settings = _skull_settings(features, seed, quick=quick)
        _demo_on_skull(output, data, settings, as_json=as_json)


def _demo_on_door(output: Path, settings: DoorSettings, *, as_json: bool) -> None:
    with progress_bars(keep=True) as progress:
        result = run_door(output, settings, progress)
        progress("writing the report", 0, 1)
        report = result.output / "report.html"
        write_report(report, door_report(result))
        progress("writing the report", 1, 1)
    if as_json:
        print_json({**_door_document(result), **_shared_document(result, report)})
        return
    print_line("")
    _print_models(result)
    _print_new_view(result)
    print_line("")
    note("these numbers are the simulated cell's, not a real sensor's")
    _print_files(result, report)


def _demo_on_skull(output: Path, data: Path, settings: SkullSettings, *, as_json: bool) -> None:
    with progress_bars(keep=True) as progress:
        result = run_skull(output, data, settings, progress)
        progress("writing the report", 0, 1)
        report = result.output / "report.html"
        write_report(report, skull_report(result))
        progress("writing the report", 1, 1)
    if as_json:
        print_json({**_skull_document(result), **_shared_document(result, report)})
        return
    print_line("")
    _print_decoding(result)
    _print_models(result)
    print_line("")
    note(
        "the exposure times are emulated: recorded grey values scaled, rounded and clipped, "
        "the recording counting as a nominal 10 ms"
    )
    note(
        f"{percent(result.overlap)} % of the unseen features' ring pixels also lie in the ring of "
        "a feature that trained"
    )
    _print_files(result, report)


def _door_settings(seed: int, *, quick: bool) -> DoorSettings:
    if quick:
        models = tuple(map(model_named, _QUICK_MODELS))
        return DoorSettings(seed=seed, plan=PLANS[_QUICK_PLAN], models=models, restarts=1)
    return DoorSettings(seed=seed)


def _skull_settings(features: int | None, seed: int, *, quick: bool) -> SkullSettings:
    if quick:
        return SkullSettings(
            features=features or 60,
            steps_per_decade=4,
            steps_each_way=3,
            seed=seed,
            restarts=1,
            models=tuple(map(model_named, _QUICK_MODELS)),
        )
    return SkullSettings(features=features or _FULL.features, seed=seed)


def _shared_document(result: DemoResult, report: Path) -> dict[str, object]:
    return {
        "observations": len(result.table),
        "visibility": result.table.counts(),
        "models": [
            {
                "model": own.model.name,
                "target": own.model.target,
                "unit": own.model.unit,
                "known_features": asdict(own.known.score),
                "unseen_features": asdict(own.unseen.score),
                "seconds": own.seconds,
            }
            for own in result.results
        ],
        "output": result.output,
        "report": report,
    }


def _door_document(result: DoorResult) -> dict[str, object]:
    view = result.new_view
    return {
        "simulated": True,
        "plan": result.settings.plan.name,
        "views": result.n_views,
        "captures": result.n_captures,
        "trained_features": sorted(result.train_features),
        "new_view": {
            "chosen_ms": view.chosen_ms,
            "exposures_ms": view.taken.exposures_ms,
            "score": asdict(view.score),
            "features": [
                {
                    "feature": name,
                    "predicted_p_norm": view.taken.p_norm[i].tolist(),
                    "predicted_std": view.taken.p_norm_std[i].tolist(),
                    "measured_p_norm": view.p_norm[i].tolist(),
                }
                for i, name in enumerate(view.taken.features)
            ],
        },
    }


def _skull_document(result: SkullResult) -> dict[str, object]:
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
        "unseen_rings_overlap": result.overlap,
    }


def _print_new_view(result: DoorResult) -> None:
    view = result.new_view
    chosen = view.taken.exposures_ms.index(view.chosen_ms)
    print_line("")
    print_table(
        ("feature", "trained", "predicted\np_norm", "± 2σ", "measured\np_norm"),
        (
            (
                name,
                "yes" if name in result.train_features else "no",
                f"{view.taken.p_norm[i, chosen]:.2f}",
                f"{2 * view.taken.p_norm_std[i, chosen]:.2f}",
                f"{view.p_norm[i, chosen]:.2f}",
            )
            for i, name in enumerate(view.taken.features)
        ),
        title=f"A view not in the campaign: {number(view.chosen_ms)} ms was chosen by forecast, "
        "then taken",
    )
    means = ", ".join(
        f"{mean:.2f} at {number(own)} ms"
        for mean, own in zip(view.p_norm.mean(axis=0), view.taken.exposures_ms, strict=True)
    )
    print_line(f"mean of what was measured: {means}")


def _print_decoding(result: SkullResult) -> None:
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


def _print_models(result: DemoResult) -> None:
    print_table(
        ("model", "predicts", "known\nR² %", "known\nRMSE", "unseen\nR² %", "unseen\nRMSE"),
        (
            (
                own.model.name,
                own.model.title,
                *_cells(own.known),
                *_cells(own.unseen),
            )
            for own in result.results
        ),
        title="Models, on the features that trained them and on features they never saw",
        words=("predicts",),
    )


def _print_files(result: DemoResult, report: Path) -> None:
    best = result.output / "models" / f"{result.results[0].model.name}{MODEL_SUFFIX}"
    program = sys.argv[0] if "exposight" in sys.argv[0] else "exposight"
    print_line(f"report:       {report}")
    print_line(f"observations: {result.output / 'observations.csv'}")
    print_line(f"campaign:     {result.output / 'campaign'}")
    print_line(f"next:         {program} info {best}")


def _cells(evaluation: Evaluation) -> tuple[str, str]:
    quality = evaluation.model.target == "p_norm"
    scale, unit = (100.0, "%") if quality else (1.0, "ms")  # percent of full scale, as the paper
    score = evaluation.score
    return f"{score.r2_percent:.1f}", f"{number(scale * score.rmse, 3)} {unit}"
