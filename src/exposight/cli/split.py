"""``exposight split``: an observation table into training and test data."""

from pathlib import Path
from shlex import quote
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.types import NonNegativeInt
from cyclopts.validators import Number

from exposight.cli.result import Result, Written, fact
from exposight.files import make_folder
from exposight.observing import ObservationTable, read_observations
from exposight.tables import Column, Table


def split_command(
    observations: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")] = Path("split"),
    by: Literal["feature", "view", "row"] = "feature",
    test_share: Annotated[float, Parameter(validator=Number(gt=0.0, lt=1.0))] = 0.2,
    seed: NonNegativeInt = 1,
) -> Result:
    """Split an observation table into training and test data.

    By feature, the test tells how well a model does on new features; by view, at new positions. By
    row, as in the paper, other exposure times of the same feature in the same view are training
    data, which flatters.

    For example:

        exposight split observations.csv --by feature --test-share 0.2 -o split

    Parameters
    ----------
    observations
        Observation table, .csv or .parquet.
    output
        Folder for the two tables.
    by
        Rows that stay together: all of a feature, all of a view, or none.
    test_share
        Share of features, views or rows that become test data, between 0 and 1.
    seed
        Random seed.
    """
    table = read_observations(observations)
    train, test = table.split(by=by, share=1.0 - test_share, seed=seed)
    sides = {"train": train, "test": test}
    make_folder(output, "the tables")
    suffix = observations.suffix.lower()
    files = tuple(
        Written.at(output / f"{side}{suffix}", f"{side} table", inputs=(observations,))
        for side in sides
    )
    for file, part in zip(files, sides.values(), strict=True):
        part.write(file.path)
    only_test = sorted(set(test.names("feature")) - set(train.names("feature")))
    return Result(
        title=str(observations),
        facts=(
            fact("by", by),
            fact("seed", seed),
            fact("test_features", only_test, ", ".join(only_test)),
        ),
        tables=(_summary(sides),),
        notes=("test rows have near copies among the training rows: other exposure times",)
        if by == "row"
        else (),
        files=files,
        next_step=f"train {quote(str(files[0].path))}",
    )


def _summary(sides: dict[str, ObservationTable]) -> Table:
    return Table.of(
        "sides",
        (
            {
                "side": side,
                "rows": len(part),
                "measured": len(part.measured()),
                "features": len(set(part.names("feature"))),
                "views": len(set(part.names("view"))),
            }
            for side, part in sides.items()
        ),
        tuple(Column(name=name) for name in ("side", "rows", "measured", "features", "views")),
    )
