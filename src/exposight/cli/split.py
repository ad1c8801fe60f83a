"""``exposight split``: an observation table into training and test data."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from cyclopts import Parameter
from cyclopts.types import NonNegativeInt

from exposight.cli.result import Result, Written, fact
from exposight.errors import ObservationError
from exposight.files.durable import make_folder
from exposight.observing import read_observations
from exposight.statistics import random_split, split_by_group
from exposight.tables import Column, Table, counted

if TYPE_CHECKING:
    from exposight.observing import ObservationTable
    from exposight.statistics import Split


def split_command(
    observations: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")] = Path("split"),
    by: Literal["feature", "view", "row"] = "feature",
    share: float = 0.2,
    seed: NonNegativeInt = 1,
) -> Result:
    """Split an observation table into training and test data.

    By feature, the test tells how well a model does on new features; by view, at new positions. By
    row, as in the paper, other exposure times of the same feature in the same view are training
    data, which flatters.

    For example:

        exposight split observations.csv --by feature --share 0.2 -o split

    Parameters
    ----------
    observations
        Observation table, .csv or .parquet.
    output
        Folder for the two tables.
    by
        Rows that stay together: all of a feature, all of a view, or none.
    share
        Share of features, views or rows that become test data, between 0 and 1.
    seed
        Random seed.
    """
    table = read_observations(observations)
    if len(table) == 0:
        msg = f"{observations}: the table has no rows, so there is nothing to split"
        raise ObservationError(msg)
    rows = _split(table, by, share, np.random.default_rng(seed), observations)
    everything = np.arange(len(table))
    sides = {
        side: table.where(np.isin(everything, chosen)) for side, chosen in rows._asdict().items()
    }
    for side, part in sides.items():
        if len(part.measured()) == 0:
            msg = (
                f"{observations}: the rows to {side} hold no measured observation; take another "
                "--seed or --share"
            )
            raise ObservationError(msg)
    make_folder(output, "the tables")
    suffix = observations.suffix.lower()
    files = tuple(
        Written.at(output / f"{side}{suffix}", f"{side} table", inputs=(observations,))
        for side in sides
    )
    for file, part in zip(files, sides.values(), strict=True):
        part.write(file.path)
    only_test = sorted(set(sides["test"].names("feature")) - set(sides["train"].names("feature")))
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


def _split(
    table: ObservationTable, by: str, share: float, rng: np.random.Generator, path: Path
) -> Split:
    """Split the rows' numbers, and say in this command's words if that cannot be."""
    if not 0.0 < share < 1.0:
        msg = f"expected a --share between 0 and 1, such as 0.2, got {share:g}"
        raise ObservationError(msg)
    names = np.arange(len(table)) if by == "row" else table.names(by)
    groups = len(set(names.tolist()))
    try:
        if by == "row":
            return random_split(groups, 1.0 - share, rng)
        return split_by_group(names.astype(str), 1.0 - share, rng)
    except ObservationError as error:
        msg = (
            f"{path}: a share of {share:g} of {counted(groups, by)} leaves no {by} to train or "
            "none to test; choose another --share, or split by something else"
        )
        raise ObservationError(msg) from error


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
