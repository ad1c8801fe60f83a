"""``exposight split``: a table of observations into one that trains and one that tests."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from exposight.cli.arguments import keep_inputs, make_folder
from exposight.cli.output import (
    JsonOption,
    count,
    counted,
    note,
    print_json,
    print_line,
    print_table,
    wrote,
)
from exposight.errors import ObservationError
from exposight.observing import read_observations
from exposight.statistics import random_split, split_by_group

if TYPE_CHECKING:
    from exposight.observing import ObservationTable
    from exposight.statistics import Split


class Groups(StrEnum):
    """What stays together."""

    FEATURE = "feature"
    VIEW = "view"
    ROW = "row"


_Observations = Annotated[
    Path, typer.Argument(metavar="OBSERVATIONS", help="Observation table, .csv or .parquet.")
]
_Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder for the two tables.")
]
_By = Annotated[
    Groups, typer.Option(help="What stays together: all rows of a feature, of a view, or none.")
]
_Share = Annotated[
    float, typer.Option(metavar="SHARE", help="Of features, views or rows that test, 0 to 1.")
]
_Seed = Annotated[int, typer.Option(metavar="N", min=0, help="Of the draw.")]


def split_command(
    observations: _Observations,
    output: _Output = Path("split"),
    by: _By = Groups.FEATURE,
    share: _Share = 0.2,
    seed: _Seed = 1,
    as_json: JsonOption = False,
) -> None:
    """Split a table of observations into one to train and one to test.

    By features, the test says how good a model is for features it never saw; by
    views, for positions that it never saw. By rows, as in the paper, other
    exposure times of the same feature at the same view train, which flatters.

    For example:

      exposight split observations.csv --by feature --share 0.2 -o split
    """
    if not 0.0 < share < 1.0:
        msg = f"expected a share between 0 and 1, such as 0.2, got {share:g}"
        raise typer.BadParameter(msg, param_hint="--share")
    table = read_observations(observations)
    if len(table) == 0:
        msg = f"{observations}: the table has no rows, so there is nothing to split"
        raise ObservationError(msg)
    sides = _split(table, by, share, np.random.default_rng(seed), observations)
    masks = {side: np.isin(np.arange(len(table)), rows) for side, rows in sides._asdict().items()}
    parts = {side: table.where(mask) for side, mask in masks.items()}
    for side, part in parts.items():
        if len(part.measured()) == 0:
            msg = (
                f"{observations}: the rows to {side} hold no measured observation; take another "
                "--seed or --share"
            )
            raise ObservationError(msg)
    make_folder(output, "the tables")
    files = {side: output / f"{side}{observations.suffix.lower()}" for side in parts}
    for path in files.values():
        keep_inputs(path, observations)
    replaced = {side: path.exists() for side, path in files.items()}
    for side, part in parts.items():
        part.write(files[side])
    if as_json:
        print_json(
            {
                "observations": observations,
                "by": by.value,
                "seed": seed,
                **{
                    side: {**_document(files[side], part), "replaced": replaced[side]}
                    for side, part in parts.items()
                },
            }
        )
        return
    _print(observations, parts, files, replaced)
    if by is Groups.ROW:
        note("rows that test have near copies among those that train: other exposure times")


def _split(
    table: ObservationTable, by: Groups, share: float, rng: np.random.Generator, path: Path
) -> Split:
    """Split the rows' numbers, and say in this command's words if that cannot be."""
    names = np.arange(len(table)) if by is Groups.ROW else table.names(by.value)
    groups = len(set(names.tolist()))
    try:
        if by is Groups.ROW:
            return random_split(groups, 1.0 - share, rng)
        return split_by_group(names.astype(str), 1.0 - share, rng)
    except ObservationError as error:
        msg = (
            f"{path}: a share of {share:g} of {counted(groups, by.value)} leaves no {by.value} to "
            "train or none to test; choose another --share, or split by something else"
        )
        raise ObservationError(msg) from error


def _document(path: Path, part: ObservationTable) -> dict[str, object]:
    return {
        "file": path,
        "rows": len(part),
        "measured": len(part.measured()),
        "features": sorted(set(part.names("feature"))),
        "views": sorted(set(part.names("view"))),
    }


def _print(
    path: Path,
    parts: dict[str, ObservationTable],
    files: dict[str, Path],
    replaced: dict[str, bool],
) -> None:
    print_line(f"{path}", style="bold")
    print_table(
        ("to", "rows", "measured", "features", "views"),
        (
            (
                side,
                count(len(part)),
                count(len(part.measured())),
                count(len(set(part.names("feature")))),
                count(len(set(part.names("view")))),
            )
            for side, part in parts.items()
        ),
    )
    features = sorted(set(parts["test"].names("feature")) - set(parts["train"].names("feature")))
    if features:
        print_line(f"features that only test: {', '.join(features)}")
    for side, own in files.items():
        wrote("", own, replaced=replaced[side])
    print_line(f"next: exposight train {quote(str(files['train']))}")
