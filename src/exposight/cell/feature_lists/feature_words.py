"""How people name the columns of a list of features, and its kinds."""

import re
from collections.abc import Mapping, Sequence

from exposight.cell.part import FeatureKind
from exposight.files.text_tables.column_units import plain_name, stems_and_units
from exposight.files.text_tables.columns import Wanted


def _either(stems: Sequence[str], words: Sequence[str]) -> tuple[str, ...]:
    """Return words with each of some stems before and behind them, as in ``X nominal``."""
    return tuple(name for w in words for stem in stems for name in (f"{stem} {w}", f"{w} {stem}"))


_NOMINAL = (
    *("nominal", "nom", "soll", "sollwert", "nenn", "theo", "theoretical", "target", "ref"),
    *("reference", "cad", "wert", "value"),
)
_PLACES = (
    *("pos", "position", "p", "centre", "center", "mitte", "mittelpunkt", "zentrum", "c", "cen"),
    *("coord", "coordinate", "koordinate", "koord", "location", "loc", "ort", "point", "punkt"),
    *("centro", "origin"),
)
_NORMALS = (
    *("n", "norm", "normal", "normale", "normalvektor", "outward normal", "surface normal"),
    *("normal vector", "nvec", "flächennormale"),
)
_VECTORS = (*_NORMALS, "vector", "vec", "vektor", "v", "cos", "dir", "direction", "richtung")
_DIRECTIONS = (
    *("t", "tangent", "dir", "direction", "richtung", "length direction", "slot direction", "long"),
    *("axis of length", "längsachse", "längsrichtung", "orientation"),
)

NAMES = (
    *("name", "feature", "feature name", "merkmal", "merkmalsname", "bezeichnung", "bez", "label"),
    *("nom", "nome", "nombre", "id", "feature id", "element", "elementname", "element name"),
    *("bohrung", "hole", "hole id", "hole name", "hole no", "feature no", "hole number", "nr"),
    *("no", "number", "nummer", "item", "pos", "pos nr", "description", "beschreibung"),
)
"""Columns that hold names; the first in this order is taken."""
KINDS = (
    *("kind", "feature kind", "type", "feature type", "typ", "art", "merkmalsart", "elementtyp"),
    *("merkmalstyp", "element type", "geometry", "geometrie", "shape", "form", "tipo", "hole type"),
)
_HOLES = ("hole", "bore", "drill", "bohr", "bohrungs", "loch", "feature", "kreis", "circle", "rim")
_RADIUS = ("radius", "r", "rad", "halbmesser", "rayon", "raggio", "radio")
_DIAMETER = (
    *("diameter", "d", "dia", "diam", "ø", "durchmesser", "durchm", "ødurchmesser", "dm", "dmr"),
    *("diamètre", "diametre", "diametro", "diámetro", "∅"),
)
_SIZE = ("size", "größe", "groesse", "maß", "mass", "dimension", "dim")
_SIZES = (
    *(*_SIZE[:3], "maß", "dimension", "dim", "d1", *_NOMINAL[:5]),
    *_either((*_HOLES, *_NOMINAL), _SIZE),
)


def _sized(words: Sequence[str]) -> tuple[str, ...]:
    """Return words for a size, also as that of a hole, and as the nominal one."""
    return (*words, *_either((*_HOLES, *_NOMINAL), words))


def _placed(axis: str) -> tuple[str, ...]:
    """Return what the columns of an axis' coordinate are called."""
    plain = (axis, *_either(_PLACES, (axis,)))
    return (*plain, *_either(_NOMINAL, plain))


def _turned(axis: str, own: str) -> tuple[str, ...]:
    """Return what the columns of a normal's component are called: n with the axis, or i, j, k."""
    plain = (own, *_either(_NORMALS, (axis,)), *_either(_VECTORS, (own,)))
    return (*plain, *_either(_NOMINAL, plain))


COLUMNS: tuple[Wanted, ...] = (
    Wanted(name="name", aliases=NAMES, quantity="text", required=False),
    Wanted(name="kind", aliases=KINDS, quantity="text", required=False),
    *(Wanted(name=f"{a}_mm", aliases=_placed(a), quantity="length") for a in "xyz"),
    *(Wanted(name=f"n{a}", aliases=_turned(a, own)) for a, own in zip("xyz", "ijk", strict=True)),
    Wanted(name="radius_mm", aliases=_sized(_RADIUS), quantity="length", required=False),
    Wanted(name="diameter_mm", aliases=_sized(_DIAMETER), quantity="length", required=False),
    Wanted(name="size_mm", aliases=_SIZES, quantity="length", required=False),
    Wanted(
        name="length_mm",
        aliases=("length", "l", "länge", "laenge", "longueur", "lunghezza", "overall length"),
        quantity="length",
        required=False,
    ),
    Wanted(
        name="width_mm",
        aliases=("width", "b", "w", "breite", "largeur", "larghezza"),
        quantity="length",
        required=False,
    ),
    *(Wanted(name=f"t{a}", aliases=_either(_DIRECTIONS, (a,)), required=False) for a in "xyz"),
    Wanted(
        name="finish",
        aliases=(
            *("surface", "surface finish", "oberfläche", "oberflaeche", "coating", "beschichtung"),
        ),
        quantity="text",
        required=False,
    ),
    Wanted(
        name="normal",
        aliases=(*_NORMALS[2:], "vector", "vektor"),
        quantity="text",
    ),
)
"""What a list of features may have as columns, with the names that people give them.

The last one is a whole normal in a single column: ``+Z``.
"""

_KIND_WORDS: Mapping[FeatureKind, str] = {
    "hole": "hole, holes, circle, kreis, bohrung, bore, borehole, round hole, loch, rundloch, "
    "drill hole, drilled hole, through hole, durchgangsloch, blind hole, durchgangsbohrung, "
    "sackloch, sackbohrung, innenkreis, inner circle, circ, circle inner, circle inside, "
    "circular hole, inside circle, kreis innen, alésage, hole through, hole blind, trou, foro, "
    "cercle, cerchio, agujero, círculo",
    "slot": "slot, round slot, slotted hole, langloch, oblong, oblong hole, obround, "
    "elongated hole, long hole, elongated circle, cparln, lumiere, asola, trou oblong",
    "pocket": "pocket, tasche, rectangle, rechteck, rectangular hole, rechteckloch, square hole, "
    "square slot, quadratloch, rectangular slot",
    "sphere": "sphere, kugel, ball, sphère, sfera, reference sphere, tooling ball",
    "surface_point": "surface point, surfacepoint, point, punkt, flächenpunkt, oberflächenpunkt, "
    "flaechenpunkt, pt, measuring point, messpunkt",
}
_BY_WORD: Mapping[str, FeatureKind] = {
    plain_name(word): kind for kind, words in _KIND_WORDS.items() for word in words.split(", ")
}


def kind_of(word: str) -> FeatureKind | None:
    """Return the kind that a word means, None where it is not known."""
    kind = _BY_WORD.get(plain_name(word))
    if kind is None:  # circle_1, Kreis 12
        kind = _BY_WORD.get(plain_name(re.sub(r"[\W_]*\d+$", "", word)))
    return kind


def all_but_the_first(header: Sequence[str], names: Sequence[str]) -> list[int]:
    """Return which columns are in a list of names, without the one that is first in it."""
    order = {plain_name(name): place for place, name in reversed(list(enumerate(names)))}
    places = [k for k, name in enumerate(header) if plain_name(name) in order]
    return sorted(places, key=lambda k: order[plain_name(header[k])])[1:]


_BY_NAME: Mapping[str, str] = {
    plain_name(name): column.name
    for column in reversed(COLUMNS)
    for name in (column.name, *column.aliases)
}


def known_columns(header: Sequence[str]) -> set[str]:
    """Return which columns some cells name, with a unit or without."""
    stems = (stem for cell in header for stem in (cell, *(s for s, _ in stems_and_units(cell))))
    return {_BY_NAME[name] for name in map(plain_name, stems) if name in _BY_NAME}
