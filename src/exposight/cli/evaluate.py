"""``exposight evaluate``: models on held-out observations."""

import hashlib
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from exposight.cli.app import UsageError
from exposight.cli.result import Result, fact
from exposight.models import MODEL_SUFFIX, evaluate, load_model
from exposight.observing import read_observations
from exposight.planning import ModelScores

_FORM = "exposight evaluate MODEL... OBSERVATIONS"


def evaluate_command(
    *files: Annotated[Path, Parameter(name="MODEL... OBSERVATIONS")],
) -> Result:
    """Evaluate models on held-out observations.

    R², root mean squared error (RMSE) and mean absolute error (MAE), for all rows and for those
    inside the range of the training data; beyond it, a model extrapolates. The last columns are the
    shares of observations within one and two predicted standard deviations, ideally 68.3 and
    95.4 %.

    For example:

        exposight evaluate models/q_k4.exposight-model test.csv

    Parameters
    ----------
    files
        Model files that train wrote, then an observation table, .csv or .parquet.
    """
    *paths, observations = _checked(files)
    table = read_observations(observations)
    sha256 = hashlib.sha256(observations.read_bytes()).hexdigest()
    models = [load_model(path) for path in paths]
    scores = ModelScores(evaluations=tuple(evaluate(model, table) for model in models))
    known = [model.name for model in models if model.provenance.observations_sha256 == sha256]
    notes = list(scores.remarks)
    if known:
        notes.append(f"{', '.join(known)} was trained on this very table; only unseen data tell")
    if bool(table.measured().frame["emulated"].any()):
        notes.append("emulated exposures are among the observations")
    return Result(
        title=str(observations),
        facts=(
            fact("observations", str(observations), ""),
            fact("rows", len(table)),
            fact("trained_on_this_table", known, ""),
        ),
        tables=(scores.table,),
        notes=tuple(notes),
    )


def _checked(files: tuple[Path, ...]) -> tuple[Path, ...]:
    """Check that the table comes last, after one model at least."""
    tables = [path for path in files if path.suffix.lower() in {".csv", ".parquet"}]
    if not files or files[-1].suffix == MODEL_SUFFIX:
        msg = f"the observations are missing: {_FORM}"
        if tables:
            msg = f"the observations, {tables[0]}, come last: {_FORM}"
        raise UsageError(msg)
    if len(files) == 1:
        msg = f"the models are missing: {_FORM}"
        raise UsageError(msg)
    return files
