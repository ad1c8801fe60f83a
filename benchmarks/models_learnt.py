"""How well models predict that learnt from a whole campaign, condition by condition.

Each section takes a seed and returns figures by name. What is predicted is always from pose and
exposure time alone, for random new views; of unseen features unless the name says otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

import numpy as np

from benchmarks.models_campaigns import (
    CONDITIONS,
    Condition,
    TrainAndTest,
    skull,
    tables,
)
from benchmarks.models_scores import (
    Figures,
    Measured,
    PaperModels,
    exposure_figures,
    keep_paper_models,
    model_guess,
    one_exposure_per_view,
    p_norm,
    paper_models,
    quality_figure,
    rms,
    score,
    unseen,
)
from exposight.cell import GREY_MAX, ActiveSensor, Projector
from exposight.geometry import RigidTransform
from exposight.models import WindowModel, model_named, train_all, train_window
from exposight.observing import ObservationTable
from exposight.observing.schema import REQUIRED
from exposight.twin.sensors import CameraElectronics
from exposight.twin.sensors.settings import STRIPE_LIMITS

_CONDITIONS = {condition.name: condition for condition in CONDITIONS}

FINISHES = ("primer", "paint", "brushed", "two_lobes", "foreign_surface")

_MOVED_MM, _TURNED_DEG = (30.0, 40.0, 0.0), 5.0  # 50 mm


def condition(name: str) -> Condition:
    """Return a condition by its name."""
    return _CONDITIONS[name]


@cache
def observed(name: str, seed: int) -> TrainAndTest:
    """Return a condition's measured rows."""
    both = tables(condition(name), seed)
    return TrainAndTest(train=both.train.measured(), test=both.test.measured())


@cache
def learnt(name: str, seed: int) -> WindowModel:
    """Return the model of a condition's whole training campaign."""
    return train_window(observed(name, seed).train, sensor=condition(name).sensor)


@cache
def papers(name: str, seed: int) -> PaperModels:
    """Return the paper's models of a condition's training campaign."""
    return paper_models(observed(name, seed).train, condition(name).sensor)


def train_papers(seeds: Iterable[int], workers: int) -> None:
    """Train and keep the paper's models of all conditions, several at a time."""
    conditions = ("bare", "one_image", *FINISHES, "stereo")
    campaigns = [
        (observed(name, seed).train, condition(name).sensor)
        for name in conditions
        for seed in seeds
    ]
    keep_paper_models(campaigns, workers=workers)


def unseen_rows(name: str, seed: int) -> ObservationTable:
    """Return a condition's test rows of features that trained nothing."""
    rows = observed(name, seed).test
    return rows.where(unseen(rows))


def bare(seed: int) -> Figures:
    """Judge the model of bare sheet: quality, exposure time, limits."""
    model, paper, test = learnt("bare", seed), papers("bare", seed), observed("bare", seed).test
    new = unseen(test)
    rows, guess, chains = test.where(new), model_guess(model, test), paper.chains(test)
    scores = {name: score(rows, each.where(new)) for name, each in chains.items()}
    of_stripes = {
        name: score(unseen_rows("one_image", seed), each)
        for name, each in papers("one_image", seed).chains(unseen_rows("one_image", seed)).items()
    }
    ours = score(rows, guess.where(new))
    theirs = min(scores.values(), key=lambda each: each.rmse_percent)
    best_paper = min(each.rmse_percent for each in (*scores.values(), *of_stripes.values()))
    chosen, best = one_exposure_per_view(test, guess.chance)
    chosen_paper = max(one_exposure_per_view(test, each.chance)[0] for each in chains.values())
    exposure, relative = exposure_figures(model, rows, paper)
    figures = {
        "quality_rmse_percent": Measured(
            value=ours.rmse_percent, coverage=ours.coverage, paper=theirs.rmse_percent
        ),
        "quality_ratio_to_paper": Measured(value=ours.rmse_percent / best_paper),
        "crps": Measured(value=ours.crps, paper=theirs.crps),
        "band_width": Measured(value=ours.band_width, paper=theirs.band_width),
        "coverage_2sigma": Measured(value=ours.coverage, paper=theirs.coverage),
        "coverage_2sigma_edge": Measured(value=ours.coverage_edge, paper=theirs.coverage_edge),
        "chance_brier": Measured(value=ours.brier, paper=theirs.brier),
        "one_exposure_per_view_over_best": Measured(value=chosen / best, paper=chosen_paper / best),
        "exposure_rmse_ms": exposure,
        "exposure_median_relative": relative,
        "limits_error_percent": Measured(value=limits_error_percent(model)),
        "known features": quality_figure(model, test.where(~new), paper),
    }
    for what, several in (("paper", scores), ("paper, one stripe image", of_stripes)):
        for name, each in several.items():
            figures[f"{what}: {name}"] = Measured(value=each.rmse_percent, coverage=each.coverage)
    return figures


def limits_error_percent(model: WindowModel) -> float:
    """Return the larger error of a model's two limits, by the simulated cell's own."""
    true = STRIPE_LIMITS.min_modulation, GREY_MAX - CameraElectronics().black_level
    return 100.0 * max(abs(a / b - 1.0) for a, b in zip(model.limits, true, strict=True))


def finishes(seed: int) -> Figures:
    """Judge the models of the other surfaces, each learnt from its own campaign."""
    figures = {}
    for name in FINISHES:
        rows = unseen_rows(name, seed)
        figures[name] = quality_figure(learnt(name, seed), rows, papers(name, seed))
    coverage = figures["foreign_surface"].coverage
    if coverage is not None:
        figures["foreign_surface_coverage"] = Measured(value=coverage)
    return figures


def variants(seed: int) -> Figures:
    """Judge models that know less than the whole truth of sensor, poses or brightness."""
    train, rows = observed("bare", seed).train, unseen_rows("bare", seed)
    sensor = condition("bare").sensor
    wrong = train_window(train, sensor=misplaced(sensor), mean="projector")
    one_image = observed("one_image", seed)
    return {
        "no_physics": quality_figure(train_window(train, sensor=sensor, mean="none"), rows),
        "projector_unknown": quality_figure(
            train_window(train, sensor=sensor, mean="camera"), rows
        ),
        "projector_wrong": quality_figure(wrong, rows),
        "kinematics": quality_figure(
            learnt("kinematics", seed),
            unseen_rows("kinematics", seed),
        ),
        "one_image_only": quality_figure(
            train_window(as_in_the_paper(one_image.train), sensor=sensor),
            as_in_the_paper(unseen_rows("one_image", seed)),
            papers("one_image", seed),
        ),
    }


def misplaced(sensor: ActiveSensor) -> ActiveSensor:
    """Return a sensor whose document has its projector 50 mm away and 5° turned."""
    if sensor.projector is None:
        msg = f"sensor {sensor.name!r} has no projector"
        raise ValueError(msg)
    place = sensor.projector.camera_from_projector
    shift = RigidTransform(translation_mm=np.array(_MOVED_MM))
    turn = RigidTransform.from_fanuc_wpr((0.0, 0.0, 0.0), 0.0, _TURNED_DEG, 0.0)
    moved = Projector(camera=sensor.projector.camera, camera_from_projector=shift @ place @ turn)
    return replace(sensor, projector=moved)


def as_in_the_paper(table: ObservationTable) -> ObservationTable:
    """Return measured rows with the columns alone that the paper's tables have."""
    return ObservationTable.from_frame(table.frame.select(REQUIRED))


def stereo(seed: int) -> Figures:
    """Judge the model of the sensor that matches dots."""
    model, paper = learnt("stereo", seed), papers("stereo", seed)
    rows = observed("stereo", seed).test
    new = quality_figure(model, unseen_rows("stereo", seed), paper)
    exposure, relative = exposure_figures(model, unseen_rows("stereo", seed), paper)
    if not new.paper:
        msg = "the paper's chain has no error on the stereo sensor's rows"
        raise RuntimeError(msg)
    return {
        "stereo_quality_rmse_percent": new,
        "stereo_known": quality_figure(model, rows.where(~unseen(rows)), paper),
        "stereo_ratio_to_paper": Measured(value=new.value / new.paper),
        "stereo exposure, ms": exposure,
        "stereo exposure, median relative": relative,
    }


def recorded_skull(seed: int) -> Figures:
    """Judge the model of the recorded skull on the half of its features that did not train.

    The paper's quality model is given the brightness that rows have, as in ``make bench
    NAME=real``; the chain of two models, which has to predict it, stands in a figure of its own.
    """
    recording = skull()
    if recording is None:
        return {}
    both, sensor = recording
    model = train_window(both.train, sensor=sensor)
    direct, exposure_model = train_all(
        [model_named("q_k1"), model_named("e_k6")], both.train, seed=seed, restarts=1
    )
    chain = PaperModels(models={"q_k1": direct, "q_k4": direct, "e_k6": exposure_model})
    quality = quality_figure(model, both.test)
    exposure, relative = exposure_figures(model, both.test, chain)
    given = 100.0 * rms(direct.predict(both.test).mean - p_norm(both.test))
    return {
        "skull_quality_rmse_percent": replace(quality, paper=given),
        "skull_exposure_rmse_ms": exposure,
        "skull exposure, median relative": relative,
        "skull, chain of two models": Measured(value=chain.best(both.test).rmse_percent),
    }
