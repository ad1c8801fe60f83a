"""Tables and lists as text: observations, features, what inspection programs write."""

from __future__ import annotations

import math
import tempfile
import unicodedata
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from random import Random

import numpy as np
import polars as pl
from tests.fuzz.formats import Format, Sample

from exposight.cell import Feature, read_features
from exposight.cell.feature_lists.feature_files import write_features
from exposight.observing import SCHEMA, Observation, ObservationTable, read_observations

_GREY = (0.0, 255.0)
_RANGES = {
    "exposure_ms": (1e-9, 3.6e12),  # an hour of ns, which is noticed later
    "p_norm": (0.0, 10.0),
    "x_mm": (-1e6, 1e6),
    "y_mm": (-1e6, 1e6),
    "z_mm": (-1e6, 1e6),
    "radius_mm": (0.0, 1e6),
    "n_points": (0, 2**53),
    "n_pixels": (0, 2**53),
    "i_std": _GREY,
    "incidence_deg": (0.0, 180.0),
    "largest_gap_deg": (0.0, 360.0),
    "sigma_z_mm": (0.0, 1e6),
    "plane_std_mm": (0.0, 1e6),
    "form_error_mm": (0.0, 1e6),
    "diameter_mm": (0.0, 1e6),
    "centre_error_mm": (0.0, 1e6),
    **{n: (-360.0, 360.0) for n in SCHEMA if n.endswith(("w_deg", "p_deg", "r_deg"))},
    **{n: (0.0, 1.0) for n in SCHEMA if n.endswith("_share")},
    **{n: _GREY for n in SCHEMA if n in {"i_avg", "i_median", "i_mean"} or n[-4:-2] == "_p"},
}
"""What docs/formats.md says of columns, said once more."""


def is_plain(name: str) -> bool:
    """Return whether a name has neither control characters nor such that turn the writing round."""
    odd = "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
    return not any(unicodedata.category(c) == "Cc" or c in odd for c in name)


# -- observations ---------------------------------------------------------------------------------


def _rows() -> list[Observation]:
    rows = []
    for i in range(6):
        rows.append(
            Observation(
                feature=f"f{i % 3}",
                view=f"v{i // 3}",
                exposure_ms=10.0 + 5 * (i // 3),
                p_norm=0.25 + 0.125 * i,
                i_avg=40.5 + 10 * i,
                x_mm=-30.5 + i,
                y_mm=12.25 * i,
                z_mm=580.0 - i,
                w_deg=3.5 * i,
                p_deg=-20.25,
                r_deg=0.0,
                radius_mm=6.0 + i % 3,
                n_points=100 * i + 200,
                n_pixels=800,
                i_std=4.5,
                clipped_share=0.125,
                incidence_deg=20.5,
                i_mean=38.5,
                largest_gap_deg=90.0,
                sensor="scanner",
                part="door",
                extra={"note": "new", "lamp": 1.5},
            )
        )
    return rows


def _observations(suffix: str) -> Callable[[Path], list[Sample]]:
    def samples(folder: Path) -> list[Sample]:
        path = folder / f"observations{suffix}"
        ObservationTable.from_observations(_rows()).write(path)
        return [Sample(path)]

    return samples


def _required_only(folder: Path) -> list[Sample]:
    frame = ObservationTable.from_observations(_rows()).frame
    path = folder / "table.csv"
    path.write_bytes(frame[:, :12].write_csv().encode())
    return [Sample(path)]


def _foreign_observations(folder: Path) -> list[Sample]:
    lines = ["Feature;View;t_exp [ms];Quality [%];Intensity;X [mm];Y;Z;W [°];P [°];R [°];Radius"]
    for row in _rows():
        numbers = (row.exposure_ms, 100 * (row.p_norm or 0), row.i_avg, row.x_mm, row.y_mm)
        turns = (row.z_mm, row.w_deg, row.p_deg, row.r_deg, row.radius_mm)
        cells = [f"{number:.3f}".replace(".", ",") for number in (*numbers, *turns)]
        lines.append(";".join((row.feature, row.view, *cells)))
    path = folder / "tabelle.csv"
    path.write_text("\r\n".join(lines) + "\r\n", encoding="cp1252")
    return [Sample(path)]


def _wrong_observations(table: ObservationTable) -> str:
    """Return what is wrong with observations, beside what the writer refuses."""
    for name, (low, high) in _RANGES.items():
        values = table.frame[name].drop_nulls().cast(pl.Float64).to_numpy()
        values = values[~np.isnan(values)] if name == "incidence_deg" else values
        if not ((values >= low) & (values <= high)).all():
            return f"{name} beyond {low:g} to {high:g}"
    numbers = [n for n, t in table.frame.schema.items() if t.is_float() and n in SCHEMA]
    for name in numbers:
        if name != "incidence_deg" and not table.frame[name].drop_nulls().is_finite().all():
            return f"{name} is not finite"
    for name in ("feature", "view", "sensor", "part", "kind", "finish", "tcp"):
        texts = table.frame[name].drop_nulls().to_list()
        if not all(map(is_plain, texts)):
            return f"{name} has control characters"
    if "" in table.frame["feature"].to_list() + table.frame["view"].to_list():
        return "a name is empty"
    same = table.frame.unique().group_by("feature", "view", "exposure_ms").len()
    if len(same) and same["len"].max() != 1:
        return "a feature, view and exposure time with several values"
    if not all(map(is_plain, table.frame.columns)):
        return "a column's name has control characters"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "again.csv"
        table.write(path)
        back = read_observations(path)
    if not back.frame.select(list(SCHEMA)).equals(table.frame.select(list(SCHEMA))):
        return "written and read again it is another table"
    same = set(back.further_columns) == set(table.further_columns)
    return "" if same else "further columns are others"


def _cell(column: int | str, *values: str, mark: bytes = b",") -> Callable[..., bytes | None]:
    """Return a change of one cell of a column."""

    def change(data: bytes, random: Random) -> bytes | None:
        header, *lines = data.splitlines(keepends=True)
        names = header.strip().split(mark)
        place = column if isinstance(column, int) else -1
        if isinstance(column, str):
            if column.encode() not in names:
                return None
            place = names.index(column.encode())
        row = random.randrange(len(lines))
        cells = lines[row].rstrip(b"\r\n").split(mark)
        end = lines[row][len(lines[row].rstrip(b"\r\n")) :]
        cells[place] = random.choice(values).encode()
        lines[row] = mark.join(cells) + end
        return header + b"".join(lines)

    return change


def _other_row(data: bytes, random: Random) -> bytes:
    """Repeat a row with another brightness."""
    header, *lines = data.splitlines(keepends=True)
    cells = random.choice(lines).split(b",")
    cells[4] = b"7.5"
    return header + b"".join(lines) + b",".join(cells)


_OBSERVATION_FAULTS = {
    "exposure of 0 or less": _cell("exposure_ms", "0", "-5", "nan", "inf"),
    "a share beyond 1": _cell("clipped_share", "-0.25", "1.5", "7"),
    "p_norm beyond its range": _cell("p_norm", "-0.1", "75", "1e9", "inf"),
    "grey level beyond 255": _cell("i_avg", "-1", "4000", "inf"),
    "position that is none": _cell("x_mm", "nan", "inf", "1e300", "left", "1+2j", "0x1F"),
    "angle beyond 360": _cell("w_deg", "400", "-1e9", "nan"),
    "negative count": _cell("n_points", "-1", "-500", "2.5"),
    "negative pixels": _cell("n_pixels", "-1"),
    "negative radius": _cell("radius_mm", "-6", "inf"),
    "negative spread": _cell("i_std", "-4", "inf"),
    "gap beyond 360": _cell("largest_gap_deg", "-5", "361"),
    "incidence beyond 180": _cell("incidence_deg", "-5", "400"),
    "escape in a name": _cell("feature", "f\x1b[31m1", "a\u202eb", "a\x00b", "\x9bx"),
    "no name": _cell("view", ""),
    "the same row with other values": _other_row,
}

# -- features -------------------------------------------------------------------------------------


def _features(folder: Path) -> list[Sample]:
    path = folder / "features.csv"
    path.write_text(
        "name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm,length_mm,width_mm,tx,ty,tz,finish\n"
        "f1,hole,120.5,40,-3.2,0,0,1,6,,,,,,primer\n"
        "s1,slot,200,40,-3.1,0,0,1,4,20,8,1,0,0,\n"
        "p1,pocket,20,-40,3,0,0.6,0.8,2,30,18,1,0,0,\n"
        "b1,sphere,-20,-40,3,0,0,1,10,,,,,,\n"
        "q1,surface_point,-120,0,3,1,0,0,5,,,,,,paint\n"
    )
    return [Sample(path)]


def _foreign_features(folder: Path) -> list[Sample]:
    path = folder / "liste.csv"
    path.write_text(
        "Merkmal;Typ;X [mm];Y [mm];Z [mm];I;J;K;Ø\nB1;Bohrung;10,5;20,25;1,125;0;0;1;12,5\n"
        "B2;Bohrung;110,5;20,25;1,125;0;0;1;8\nB3;Kreis;60,5;-20,25;2,5;0;0,6;0,8;12\n",
        encoding="cp1252",
    )
    return [Sample(path)]


def _dmis(folder: Path) -> list[Sample]:
    path = folder / "part.dmi"
    path.write_text(
        "DMISMN/'part',05.2\r\nUNITS/MM,ANGDEC\r\n"
        "F(H1)=FEAT/CIRCLE,INNER,CART,-60,-40.0,$\r\n 1.5,0,0,1,12.\r\n"
        "F(S1)=FEAT/CPARLN,INNER,ROUND,CART,1,2,3,0,0,1,-1,0,0,20,8\r\n"
        "F(P1)=FEAT/CPARLN,INNER,FLAT,CART,51,2,3,0,0,1,0,1,0,20,8\r\n"
        "F(B1)=FEAT/SPHERE,OUTER,CART,1,92,3,10,0,0,1\r\n"
    )
    return [Sample(path)]


def _qif(folder: Path) -> list[Sample]:
    path = folder / "plan.qif"
    circle = "Circle"
    path.write_text(
        '<?xml version="1.0"?><QIFDocument xmlns="http://qifstandards.org/xsd/qif3"><FileUnits>'
        "<PrimaryUnits><LinearUnit><SIUnitName>meter</SIUnitName><UnitName>mm</UnitName>"
        "<UnitConversion><Factor>0.001</Factor></UnitConversion></LinearUnit></PrimaryUnits>"
        "</FileUnits><Features><FeatureDefinitions>"
        f'<{circle}FeatureDefinition id="1"><InternalExternal>INTERNAL</InternalExternal>'
        f"<Diameter>12</Diameter></{circle}FeatureDefinition></FeatureDefinitions>"
        f'<FeatureNominals><{circle}FeatureNominal id="2">'
        "<FeatureDefinitionId>1</FeatureDefinitionId><Name>H1</Name><Location>1 2 3</Location>"
        f"<Normal>0 0 1</Normal></{circle}FeatureNominal></FeatureNominals>"
        "<FeatureItems></FeatureItems></Features></QIFDocument>"
    )
    return [Sample(path)]


def _wrong_features(features: tuple[Feature, ...]) -> str:
    if not features:
        return "no features"
    if len({each.name for each in features}) < len(features):
        return "two features share a name"
    for each in features:
        numbers = [
            *each.part_from_feature.to_matrix().ravel(),
            *(getattr(each, n.name) or 0.0 for n in fields(each) if n.name.endswith("_mm")),
        ]
        if not all(map(math.isfinite, numbers)) or max(map(abs, numbers)) > 1e6:
            return f"{each.name!r} has numbers that are none or beyond a kilometre"
        if min(numbers[16:]) < 0 or (each.kind in {"hole", "sphere"} and each.radius_mm <= 0):
            return f"{each.name!r} has a size below 0"
        if not is_plain(each.name + each.finish) or not each.name.strip():
            return f"{each.name!r} is no plain name"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "again.csv"
        write_features(path, features)
        again = read_features(path)
    same = all(
        (one.name, one.kind, one.finish) == (two.name, two.kind, two.finish)
        and np.allclose(
            one.part_from_feature.to_matrix(), two.part_from_feature.to_matrix(), atol=1e-6
        )
        and math.isclose(one.radius_mm, two.radius_mm, rel_tol=1e-9)
        for one, two in zip(features, again, strict=True)
    )
    return "" if same else "written and read again they are others"


_FEATURE_FAULTS = {
    "negative radius": _cell("radius_mm", "-6", "nan", "inf"),
    "position that is none": _cell("x_mm", "nan", "inf", "", "1e300", "1+2j"),
    "unknown kind": _cell("kind", "thing", "\x1b[31mhole"),
    "normal of no length": _cell("nz", "nan", "inf", "x"),
    "escape in a name": _cell("name", "f\x1b[31m1", "a\u202eb", "\x9bx", ""),
}


FORMATS = (
    Format(
        "observations CSV",
        _observations(".csv"),
        read_observations,
        wrong=_wrong_observations,
        faults=_OBSERVATION_FAULTS,
    ),
    Format(
        "observations CSV, required columns",
        _required_only,
        read_observations,
        wrong=_wrong_observations,
        faults=_OBSERVATION_FAULTS,
    ),
    Format(
        "observations Parquet",
        _observations(".parquet"),
        read_observations,
        wrong=_wrong_observations,
        text=False,
        slow=True,
    ),
    Format(
        "observations of another program",
        _foreign_observations,
        read_observations,
        wrong=_wrong_observations,
        faults={
            "exposure of 0 or less": _cell(2, "0", "-5", mark=b";"),
            "brightness beyond 255": _cell(4, "-1", "4000", mark=b";"),
            "escape in a name": _cell(0, "f\x1b[31m1", "\x00", mark=b";"),
            "complex number": _cell(5, "1+2j", "1,5j", mark=b";"),
        },
    ),
    Format("features CSV", _features, read_features, _wrong_features, _FEATURE_FAULTS),
    Format(
        "feature list of another program",
        _foreign_features,
        read_features,
        _wrong_features,
        {
            "negative diameter": _cell(8, "-6", "0", mark=b";"),
            "escape in a name": _cell(0, "f\x1b[31m1", mark=b";"),
        },
    ),
    Format("DMIS", _dmis, read_features, _wrong_features),
    Format("QIF", _qif, read_features, _wrong_features),
)
