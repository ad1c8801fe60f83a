"""``exposight evaluate``: models on held-out observations."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from exposight.cli.app import UsageError
from exposight.cli.picture_files import check_picture, write_picture
from exposight.cli.result import Result, Written, fact
from exposight.models import MODEL_SUFFIX, evaluate, load_model
from exposight.observing import read_observations
from exposight.planning import ModelScores, with_chains

_FORM = "exposight evaluate MODEL... OBSERVATIONS"


def evaluate_command(
    *files: Annotated[Path, Parameter(name="MODEL... OBSERVATIONS")],
    picture: Path | None = None,
) -> Result:
    """Evaluate models on held-out observations.

    For all rows, for those inside the range of what was learnt, and apart for features that a model
    learnt from and for unseen ones where there are both: R², root mean squared error (RMSE; of
    p_norm in percent points), the median relative error of exposure times, the shares of
    observations in the predicted 1σ and 2σ bands, ideally 68.3 and 95.4 %, the continuous ranked
    probability score (CRPS) and the logarithmic score (log score: minus the logarithm of the
    predicted density, in nats a row; p_norm in 1, widened by 0.01, exposure times in 1/ms). Of
    quality models also how well the chance of a p_norm of at least 0.75 came true.

    For example:

        exposight evaluate models/quality.exposight-model test.csv

    Parameters
    ----------
    files
        Model files that train wrote, then an observation table, .csv or .parquet.
    picture
        Draw chances and bands against what came of them: .png or .svg.
    """
    *paths, observations = _checked(files)
    if picture is not None:
        check_picture(picture)
    written = () if picture is None else (Written.at(picture, "picture", inputs=files),)
    table = read_observations(observations)
    loaded = [load_model(path) for path in paths]
    models = with_chains(loaded)
    scores = ModelScores(evaluations=tuple(evaluate(model, table) for model in models))
    known = [model.name for model in loaded if model.provenance.observations_sha256 == table.sha256]
    notes = list(scores.remarks)
    of_quality = [model for model in models if model.target == "p_norm"]
    afterwards = [model.name for model in of_quality if "i_avg" in model.inputs]
    before = [model.name for model in of_quality if model.name not in afterwards]
    if afterwards:
        notes.append(
            f"{', '.join(afterwards)} read the brightness that was measured in the capture itself"
            + (f"; {', '.join(before)} need pose and exposure time alone" if before else "")
        )
    if known:
        notes.append(f"{', '.join(known)} was trained on this very table; only unseen data tell")
    if bool(table.measured().frame["emulated"].any()):
        notes.append("emulated exposures are among the observations")
    if picture is not None:
        from exposight.report import reliability_picture  # takes seconds to import

        write_picture(picture, reliability_picture(scores.evaluations))
    return Result(
        title=str(observations),
        facts=(
            fact("observations", str(observations), ""),
            fact("rows", len(table)),
            fact("trained_on_this_table", known, ""),
        ),
        tables=scores.tables,
        notes=tuple(notes),
        contradictions=table.contradictions,
        files=written,
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
