"""How people name the columns of a list of features, and its kinds."""

import re
from collections.abc import Mapping, Sequence

from exposight.cell.part import FeatureKind
from exposight.files.column_units import plain_name
from exposight.files.columns import Wanted


def _of_axis(axis: str, *stems: str) -> tuple[str, ...]:
    """Return stems with an axis' letter before and behind."""
    return tuple(name for stem in stems for name in (f"{stem} {axis}", f"{axis} {stem}"))


_PLACES = (
    *("pos", "position", "centre", "center", "mitte", "mittelpunkt", "c", "coord", "coordinate"),
    *("koordinate", "nominal", "nom", "soll", "sollwert", "location", "loc", "ort", "point"),
)
_NORMALS = ("n", "norm", "normal", "normale", "normalvektor", "outward normal", "surface normal")
_DIRECTIONS = (
    *("t", "tangent", "dir", "direction", "richtung", "length direction", "slot direction", "long"),
    *("axis of length", "längsachse", "längsrichtung"),
)

NAMES = (
    *("name", "feature", "feature name", "featurename", "merkmal", "merkmalsname", "bezeichnung"),
    *("label", "id", "feature id", "featureid", "element", "elementname", "bohrung", "hole"),
    *("hole id", "hole name", "nr", "no", "number", "nummer"),
)
"""Columns that hold names; the first in this order is taken."""
KINDS = (
    *("kind", "feature kind", "type", "feature type", "typ", "art", "merkmalsart", "elementtyp"),
    *("merkmalstyp", "element type", "geometry", "geometrie", "shape", "form"),
)
_RADII = (
    *("radius", "r", "rad", "halbmesser", "rayon", "raggio", "radio", "nominal radius"),
    *("hole radius", "sollradius", "nennradius", "lochradius"),
)
_DIAMETERS = (
    *("diameter", "d", "dia", "diam", "ø", "durchmesser", "diamètre", "diametre", "diametro"),
    *("diámetro", "nominal diameter", "hole diameter", "bore diameter", "solldurchmesser"),
    *("nenndurchmesser", "lochdurchmesser", "bohrungsdurchmesser", "ødurchmesser", "dm"),
)
_SIZES = (
    *("size", "hole size", "feature size", "nominal size", "größe", "groesse", "lochgröße"),
    *("nominal", "nennmaß", "nennmass", "sollmaß", "sollmass", "maß", "d1", "dimension"),
    *("dim", "wert", "value"),
)

COLUMNS: tuple[Wanted, ...] = (
    Wanted(name="name", aliases=NAMES, quantity="text", required=False),
    Wanted(name="kind", aliases=KINDS, quantity="text", required=False),
    *(
        Wanted(name=f"{a}_mm", aliases=(a, *_of_axis(a, *_PLACES)), quantity="length")
        for a in "xyz"
    ),
    *(
        Wanted(name=f"n{a}", aliases=(own, *_of_axis(a, *_NORMALS), *_of_axis(own, "n", "normal")))
        for a, own in zip("xyz", "ijk", strict=True)
    ),
    Wanted(name="radius_mm", aliases=_RADII, quantity="length", required=False),
    Wanted(name="diameter_mm", aliases=_DIAMETERS, quantity="length", required=False),
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
    *(Wanted(name=f"t{a}", aliases=_of_axis(a, *_DIRECTIONS), required=False) for a in "xyz"),
    Wanted(
        name="finish",
        aliases=(
            *("surface", "surface finish", "oberfläche", "oberflaeche", "coating", "beschichtung"),
        ),
        quantity="text",
        required=False,
    ),
)
"""What a list of features may have as columns, with the names that people give them."""

_KIND_WORDS: Mapping[FeatureKind, tuple[str, ...]] = {
    "hole": (
        *("hole", "holes", "circle", "kreis", "bohrung", "bore", "borehole", "round hole", "loch"),
        *("rundloch", "drill hole", "drilled hole", "through hole", "durchgangsloch", "blind hole"),
        *("durchgangsbohrung", "sackloch", "sackbohrung", "innenkreis", "inner circle", "circ"),
        *("circle inner", "circle inside", "circular hole", "trou", "foro", "cercle", "agujero"),
    ),
    "slot": (
        *("slot", "round slot", "slotted hole", "langloch", "oblong", "oblong hole", "obround"),
        *("elongated hole", "long hole", "elongated circle", "cparln", "lumiere", "asola"),
    ),
    "pocket": (
        *("pocket", "tasche", "rectangle", "rechteck", "rectangular hole", "rechteckloch"),
        *("square hole", "square slot", "quadratloch", "rectangular slot"),
    ),
    "sphere": ("sphere", "kugel", "ball", "sphère", "sfera", "reference sphere", "tooling ball"),
    "surface_point": (
        *("surface point", "surfacepoint", "point", "punkt", "flächenpunkt", "oberflächenpunkt"),
        *("flaechenpunkt", "pt", "measuring point", "messpunkt"),
    ),
}
_BY_WORD: Mapping[str, FeatureKind] = {
    plain_name(word): kind for kind, words in _KIND_WORDS.items() for word in words
}


def kind_of(word: str) -> FeatureKind | None:
    """Return the kind that a word means, None where it is not known."""
    kind = _BY_WORD.get(plain_name(word))
    if kind is None:  # circle_1, Kreis 12
        kind = _BY_WORD.get(plain_name(re.sub(r"[\W_]*\d+$", "", word)))
    return kind


def first_of_several(header: Sequence[str], names: Sequence[str]) -> tuple[int | None, list[int]]:
    """Return which of a header's columns is the first in a list of names, and the others of it."""
    order = {plain_name(name): place for place, name in reversed(list(enumerate(names)))}
    places = [k for k, name in enumerate(header) if plain_name(name) in order]
    places.sort(key=lambda k: order[plain_name(header[k])])
    return (places[0], places[1:]) if places else (None, [])
