"""The list of a part's features as CSV (``docs/formats.md``)."""

import csv
import io
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from exposight.cell.part import RULES, Feature, FeatureKind, check_unique_names
from exposight.errors import FeatureError, FormatError
from exposight.files import check_columns, read_text, write_durably
from exposight.geometry import RigidTransform, rotation_facing

_REQUIRED = ("name", "kind", "x_mm", "y_mm", "z_mm", "nx", "ny", "nz", "radius_mm")
_OPTIONAL = ("length_mm", "width_mm", "tx", "ty", "tz", "finish")

_NORMAL_TOLERANCE = 0.05
"""How far a normal's length may be from 1: normals printed with one decimal are off by up to 4 %,
while positions taken for normals are off by far more."""

_DIRECTION_TOLERANCE_DEG = 5.0
"""How far the direction of the length may leave the feature's plane; what leaves it is dropped."""


def read_features(path: Path) -> tuple[Feature, ...]:
    """Read a list of features from a CSV file.

    Parameters
    ----------
    path : Path
        Columns ``name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm``, then optionally
        ``length_mm,width_mm``, ``tx,ty,tz`` and ``finish``. (nx, ny, nz) is the outward surface
        normal, which is turned here: a feature's z axis points into the material. (tx, ty, tz) is
        the direction of the length; slots and pockets need it.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError
        If a column has another name, order or unit, or a cell is no number.
    FeatureError
        If a number is NaN, a size is not positive, or two features share a name.
    """
    return features_from_csv(read_text(path, "feature list"), Path(path))


def write_features(path: Path, features: Iterable[Feature]) -> None:
    """Write a list of features to a CSV file that is whole or absent.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    write_durably(path, features_to_csv(features).encode())


def features_to_csv(features: Iterable[Feature]) -> str:
    """Return features as the text of a CSV file, normals outward.

    Every column is written; ``finish``, which files of earlier versions lack, where one is known.
    """
    features = tuple(features)
    finishes = [[feature.finish] for feature in features]
    if not any(map(any, finishes)):
        finishes = [[] for _ in features]
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    columns = _REQUIRED + _OPTIONAL
    writer.writerow(columns if any(finishes) else columns[:-1])
    for feature, finish in zip(features, finishes, strict=True):
        pose = feature.part_from_feature
        # Adding 0 turns −0 into 0.
        outward = 0.0 - pose.rotation[:, 2]
        writer.writerow(
            [
                feature.name,
                feature.kind,
                *map(_spell, pose.translation_mm),
                *map(_spell, outward),
                _spell(feature.radius_mm),
                "" if feature.length_mm is None else _spell(feature.length_mm),
                "" if feature.width_mm is None else _spell(feature.width_mm),
                *map(_spell, pose.rotation[:, 0]),
                *finish,
            ]
        )
    return buffer.getvalue()


def features_from_csv(text: str, source: Path) -> tuple[Feature, ...]:
    """Return the features in the text of a CSV file; see `read_features`.

    Raises
    ------
    FormatError, FeatureError
        As `read_features`.
    """
    rows = list(csv.reader(io.StringIO(text, newline="")))
    header = [cell.strip() for cell in rows[0]] if rows else []
    check_columns(header, required=_REQUIRED, optional=_OPTIONAL, source=source)
    features = []
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(header):
            msg = f"{source}, row {number}: expected {len(header)} cells, got {len(row)}"
            raise FormatError(msg)
        cells = dict(zip(header, map(str.strip, row), strict=True))
        try:
            features.append(_feature(cells))
        except (FeatureError, FormatError) as error:
            msg = f"{source}, row {number}, feature {cells['name']!r}: {error}"
            raise type(error)(msg) from error
    if not features:
        msg = f"{source} lists no feature; expected at least one row under its header"
        raise FeatureError(msg)
    try:
        check_unique_names(tuple(features))
    except FeatureError as error:
        msg = f"{source}: {error}"
        raise FeatureError(msg) from error
    return tuple(features)


def _spell(number: float) -> str:
    # The shortest text that reads back as the same number.
    return repr(float(number) + 0.0)


def _feature(cells: Mapping[str, str]) -> Feature:
    """Return the feature that a row's cells describe."""
    kind = cast("FeatureKind", cells["kind"])
    if kind not in RULES:
        msg = f"the kind must be one of {', '.join(RULES)}, got {kind!r}"
        raise FeatureError(msg)
    return Feature(
        name=cells["name"],
        kind=kind,
        part_from_feature=RigidTransform(
            rotation=_rotation(cells, needs_direction=RULES[kind].has_length),
            translation_mm=_vector(cells, "x_mm", "y_mm", "z_mm"),
        ),
        radius_mm=_number(cells, "radius_mm"),
        length_mm=_number(cells, "length_mm") if cells.get("length_mm") else None,
        width_mm=_number(cells, "width_mm") if cells.get("width_mm") else None,
        finish=cells.get("finish", ""),
    )


def _rotation(cells: Mapping[str, str], *, needs_direction: bool) -> NDArray[np.float64]:
    normal = _vector(cells, "nx", "ny", "nz")
    length = float(np.linalg.norm(normal))
    if abs(length - 1) > _NORMAL_TOLERANCE:
        msg = f"the outward normal (nx, ny, nz) must have length 1, got {length:g}"
        raise FeatureError(msg)
    if not any(cells.get(column) for column in ("tx", "ty", "tz")):
        if needs_direction:
            msg = f"a {cells['kind']} needs the direction of its length in the columns tx, ty, tz"
            raise FeatureError(msg)
        return rotation_facing(-normal)
    direction = _vector(cells, "tx", "ty", "tz")
    span = float(np.linalg.norm(direction))
    out_of_plane = abs(float(direction @ normal)) / length
    if not span > 0 or out_of_plane > span * math.sin(math.radians(_DIRECTION_TOLERANCE_DEG)):
        msg = (
            "the direction (tx, ty, tz) must lie in the surface, at right angles to the normal, "
            f"got {direction.tolist()} for normal {normal.tolist()}"
        )
        raise FeatureError(msg)
    return rotation_facing(-normal, direction)


def _vector(cells: Mapping[str, str], *columns: str) -> NDArray[np.float64]:
    return np.array([_number(cells, column) for column in columns])


def _number(cells: Mapping[str, str], column: str) -> float:
    text = cells.get(column, "")
    try:
        number = float(text)
    except ValueError as error:
        msg = f"column {column}: expected a number, got {text!r}"
        raise FormatError(msg) from error
    if not math.isfinite(number):
        msg = f"column {column}: expected a finite number, got {text!r}"
        raise FeatureError(msg)
    return number
