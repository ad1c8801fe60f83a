"""The list of a part's features: our own CSV file, and what other programs write.

``docs/formats.md`` says what is read.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight.cell.feature_lists.dmis import features_from_dmis, is_dmis
from exposight.cell.feature_lists.feature_tables import features_from_table
from exposight.cell.feature_lists.feature_words import kind_of
from exposight.cell.feature_lists.listed_features import ListFaults, listed_feature
from exposight.cell.feature_lists.qif import features_from_qif, is_qif
from exposight.cell.part import RULES, Feature
from exposight.errors import FeatureError, FormatError
from exposight.files import (
    Reading,
    current_reading,
    guarded,
    parsing,
    read_bytes,
    recognised,
    unguarded,
    write_durably,
)

_REQUIRED = ("name", "kind", "x_mm", "y_mm", "z_mm", "nx", "ny", "nz", "radius_mm")
_OPTIONAL = ("length_mm", "width_mm", "tx", "ty", "tz", "finish")


def read_features(path: Path, *, reading: Reading | None = None) -> tuple[Feature, ...]:
    """Read a list of features: our own CSV file, a table in any dialect, DMIS or QIF.

    Parameters
    ----------
    path : Path
        A table with a name, a kind, the position, the outward surface normal and a radius or a
        diameter in each row, slots and pockets also with length, width and the direction of the
        length (``docs/formats.md``, Features); or a DMIS program or a QIF document. Which it is
        its content tells. Normals are turned here: a feature's z axis points into the material.
    reading : Reading, optional
        How it is to be read where it does not tell.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError, FeatureError
        If columns are missing, cells are no numbers, sizes make no sense, or features share a
        name; all faults at once.
    AmbiguousError
        If two readings fit equally well, such as a size that is a radius or a diameter.
    """
    path = Path(path)
    data = read_bytes(path, "feature list")
    reading = current_reading(reading)
    with parsing(path, "list of features"):
        return _features(data, path, reading)


def _features(data: bytes, path: Path, reading: Reading) -> tuple[Feature, ...]:
    if is_dmis(data) or path.suffix.lower() in {".dmi", ".dmis", ".dms"}:
        return features_from_dmis(data, path, reading)
    if is_qif(data) or path.suffix.lower() == ".qif":
        return features_from_qif(data, path, reading)
    for start, what in _NO_LISTS:
        if data.startswith(start):
            msg = f"{path}: expected a list of features, got {what}"
            raise FormatError(msg)
    text = _own_text(data)
    if text is None:
        return features_from_table(data, path, reading)
    inward = reading.normals == "inward"
    if inward:
        recognised(path, "normals turned outward, as told")
    features = features_from_csv(text, path, inward=inward)
    places = np.array([each.part_from_feature.translation_mm for each in features])
    faults = ListFaults(path)
    faults.add_stand_ins(
        dict(zip(("x_mm", "y_mm", "z_mm"), places.T, strict=True)),
        [f"feature {each.name!r}" for each in features],
    )
    faults.settle()
    return features


_NO_LISTS = (
    (b"PK\x03\x04", "a workbook: save its sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "a workbook: save its sheet as CSV"),
    (b"ISO-10303-21", "a STEP file: `exposight part FILE -o FOLDER` finds its holes"),
    (b"solid", "a mesh: `exposight part FILE -o FOLDER` finds its holes"),
    (b"ply", "a mesh or a cloud: `exposight part FILE -o FOLDER` finds a mesh's holes"),
    (b"glTF", "a mesh: `exposight part FILE -o FOLDER` finds its holes"),
    (b"%PDF", "a PDF: copy its table into a CSV file"),
    (b"<", "XML or HTML that is no QIF document: write it as a table, CSV say"),
    (b"{", "JSON: write it as a table, CSV say"),
)
"""First bytes of what is no list of features, and what to do with it."""

_COMMA_IN_CELL = re.compile(r'"\s*[+-]?\d+,\d+\s*"')


def _own_text(data: bytes) -> str | None:
    """Return the text of a file that is written as our own files are; else None."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    header = [cell.strip() for cell in text.split("\n", 1)[0].split(",")]
    if header != _own_columns(header) or _COMMA_IN_CELL.search(text):
        return None
    kinds = {row[1].strip() for row in csv.reader(io.StringIO(text, newline="")) if len(row) > 1}
    translated = any(kind not in RULES and kind_of(kind) for kind in kinds - {"kind"})
    return None if translated else text


def _own_columns(header: Sequence[str]) -> list[str]:
    """Return how a header is written in our own files."""
    return [*_REQUIRED, *(column for column in _OPTIONAL if column in header)]


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
    finishes = [[guarded(feature.finish)] for feature in features]
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
                guarded(feature.name),
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


def features_from_csv(text: str, source: Path, *, inward: bool = False) -> tuple[Feature, ...]:
    """Return the features in the text of a CSV file as `write_features` writes it.

    Parameters
    ----------
    text : str
    source : Path
        Where it came from, for messages.
    inward : bool
        Whether the normals point into the material.

    Raises
    ------
    FormatError, FeatureError
        As `read_features`.
    """
    with parsing(source, "list of features"):
        rows = list(csv.reader(io.StringIO(text, newline="")))
    header = [cell.strip() for cell in rows[0]] if rows else []
    if header != _own_columns(header):
        msg = (
            f"{source}: expected the columns {','.join(_REQUIRED)}[,{'][,'.join(_OPTIONAL)}], got "
            f"{','.join(header)}"
        )
        raise FormatError(msg)
    features, names, numbers = list[Feature](), list[str](), list[int]()
    faults = ListFaults(source)
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(header):
            msg = f"expected {len(header)} cells, got {len(row)}"
            faults.add(f"row {number}", FormatError(msg))
            continue
        cells = dict(zip(header, map(str.strip, row), strict=True))
        cells["name"], cells["finish"] = map(unguarded, (cells["name"], cells.get("finish", "")))
        names.append(cells["name"])
        numbers.append(number)
        try:
            features.append(_feature(cells, inward=inward))
        except (FeatureError, FormatError) as error:
            faults.add(f"row {number}, feature {cells['name']!r}", error)
    faults.add_repeated(names, numbers)
    faults.settle()
    if not features:
        msg = f"{source} lists no feature; expected at least one row under its header"
        raise FeatureError(msg)
    return tuple(features)


def _spell(number: float) -> str:
    # The shortest text that reads back as the same number.
    return repr(float(number) + 0.0)


def _feature(cells: Mapping[str, str], *, inward: bool) -> Feature:
    """Return the feature that a row's cells describe."""
    normal = _vector(cells, "nx", "ny", "nz")
    directed = any(cells.get(column) for column in ("tx", "ty", "tz"))
    return listed_feature(
        name=cells["name"],
        kind=cells["kind"],
        place_mm=_vector(cells, "x_mm", "y_mm", "z_mm"),
        normal=0.0 - normal if inward else normal,
        direction=_vector(cells, "tx", "ty", "tz") if directed else None,
        radius_mm=_number(cells, "radius_mm"),
        length_mm=_number(cells, "length_mm") if cells.get("length_mm") else None,
        width_mm=_number(cells, "width_mm") if cells.get("width_mm") else None,
        finish=cells["finish"],
    )


def _vector(cells: Mapping[str, str], *columns: str) -> NDArray[np.float64]:
    return np.array([_number(cells, column) for column in columns])


def _number(cells: Mapping[str, str], column: str) -> float:
    text = cells.get(column, "")
    try:
        number = float("" if "_" in text else text)  # Python's own 1_000 is nobody else's
    except ValueError as error:
        msg = f"column {column}: expected a number, got {text!r}"
        raise FormatError(msg) from error
    if not math.isfinite(number):
        msg = f"column {column}: expected a finite number, got {text!r}"
        raise FeatureError(msg)
    return number
