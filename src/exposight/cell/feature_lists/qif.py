"""Circles and slots of QIF 3 documents (ISO 23952), as nominal features of a part."""

import math
import xml.parsers.expat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from exposight.cell.feature_lists.listed_features import ListFaults, left_out, listed_feature
from exposight.cell.part import Feature, FeatureKind
from exposight.errors import ExposightError, FeatureError, FormatError
from exposight.files import Reading, recognised

_Node: TypeAlias = ElementTree.Element

_KINDS: Mapping[str, FeatureKind] = {
    "CircleFeature": "hole",
    "ElongatedCircleFeature": "slot",
    "OppositeParallelLinesFeature": "slot",
}
"""Features that are read; opposite parallel lines with flat ends are pockets."""


def is_qif(data: bytes) -> bool:
    """Tell by its root whether a file is a QIF document."""
    return b"QIFDocument" in data[:4096] or b"Q\0I\0F\0D\0" in data[:4096]


@dataclass(frozen=True, kw_only=True)
class _Units:
    """The document's lengths: primary unit in mm, and others by name."""

    primary_mm: float
    primary: str
    others_mm: Mapping[str, float]

    def mm(self, node: _Node | None, what: str) -> float:
        """Return a length in mm.

        Raises
        ------
        FormatError
            If it is missing, no number, or in a unit that the document does not define.
        """
        value = _floats(node)
        unit = "" if node is None else node.get("linearUnit", "")
        if unit and unit != self.primary and unit not in self.others_mm:
            msg = f"{what} is in {unit!r}, a unit that the document does not define"
            raise FormatError(msg)
        if value.size != 1:
            msg = f"expected a number as {what}, got {_text(node)!r}"
            raise FormatError(msg)
        return float(value[0]) * self.others_mm.get(unit, self.primary_mm)

    def place_mm(self, node: _Node | None, what: str) -> NDArray[np.float64]:
        """Return a place, (3,) mm."""
        unit = "" if node is None else node.get("linearUnit", "")
        return _vector(node, what) * self.others_mm.get(unit, self.primary_mm)


def features_from_qif(data: bytes, path: Path, reading: Reading) -> tuple[Feature, ...]:
    """Return the circles and slots that a QIF document holds as nominal features.

    Internal circles become holes, internal elongated circles and opposite parallel lines with round
    ends slots, with flat ends pockets with sharp corners. Normals are taken for outward ones,
    unless `reading` says that they are inward.

    Parameters
    ----------
    data : bytes
        The whole document.
    path : Path
        Its name, for messages.
    reading : Reading

    Raises
    ------
    FormatError, FeatureError
        With all faults at once; also where it is no such document, or holds no such feature.
    """
    root = _parsed(data, path)
    units = _units(root, path)
    definitions = {node.get("id", ""): node for node in _children(root, "FeatureDefinitions")}
    items = {
        _text(_child(node, "FeatureNominalId")): node for node in _children(root, "FeatureItems")
    }
    features, names, left = list[Feature](), list[str](), dict[str, int]()
    faults = ListFaults(path)
    for nominal in _children(root, "FeatureNominals"):
        what = _name(nominal).removesuffix("Nominal")
        definition = definitions.get(_text(_child(nominal, "FeatureDefinitionId")))
        if what not in _KINDS or _text(_child(definition, "InternalExternal")) == "EXTERNAL":
            side = "external " if what in _KINDS else ""
            left[side + what] = left.get(side + what, 0) + 1
            continue
        item = items.get(nominal.get("id", ""))
        name = (
            _text(_child(nominal, "Name"))
            or _text(_child(item, "FeatureName"))
            or f"feature {nominal.get('id', len(names) + 1)}"
        )
        names.append(name)
        try:
            if definition is None:
                msg = "its definition (FeatureDefinitionId) is not in the document"
                raise FormatError(msg)
            inward = reading.normals == "inward"
            features.append(_feature(name, what, nominal, definition, units, inward=inward))
        except ExposightError as error:
            faults.add(f"feature {name!r}", error)
    faults.add_repeated(names, range(1, len(names) + 1))
    faults.settle()
    if not features:
        found = left_out(left) or "none at all"
        msg = f"{path}: expected nominal circles or slots (CircleFeatureNominal), got {found}"
        raise FeatureError(msg)
    remarks = ["QIF document", f"lengths in {units.primary}"]
    if left:
        remarks.append(f"not read: {left_out(left)}")
    if reading.normals == "inward":
        remarks.append("normals turned outward, as told")
    recognised(path, *remarks)
    return tuple(features)


def _parsed(data: bytes, path: Path) -> _Node:
    """Return the root of a document; what declares entities is not expanded but refused."""

    def refuse(*_: object) -> None:
        msg = f"{path}: a QIF document has no DOCTYPE; this one is refused, for it may expand"
        raise FormatError(msg)

    guard = xml.parsers.expat.ParserCreate()
    guard.StartDoctypeDeclHandler = refuse
    try:
        guard.Parse(data, True)
        root = ElementTree.fromstring(data)
    except (xml.parsers.expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as error:
        msg = f"{path} cannot be read as XML ({error}); expected a QIF document, whole"
        raise FormatError(msg) from error
    if _name(root) != "QIFDocument":
        msg = f"{path}: expected a QIFDocument, got {_name(root)!r}"
        raise FormatError(msg)
    return root


def _units(root: _Node, path: Path) -> _Units:
    """Return the document's units of length; without any they are metres, as SI has them."""
    units = _child(root, "FileUnits")
    primary = _child(_child(units, "PrimaryUnits"), "LinearUnit")
    others = _child(units, "OtherUnits")
    try:
        return _Units(
            primary_mm=_unit_mm(primary),
            primary=_text(_child(primary, "UnitName")) or "m",
            others_mm={
                _text(_child(unit, "UnitName")): _unit_mm(unit)
                for unit in (() if others is None else others)
                if _name(unit) == "LinearUnit"
            },
        )
    except FormatError as error:
        msg = f"{path}: {error}"
        raise FormatError(msg) from error


def _unit_mm(unit: _Node | None) -> float:
    factor = _child(_child(unit, "UnitConversion"), "Factor")
    if factor is None:
        return 1000.0
    value = _floats(factor)
    if value.size != 1 or not 0.0 < value[0] < math.inf:
        msg = f"expected a number above 0 as factor of a unit, got {_text(factor)!r}"
        raise FormatError(msg)
    return 1000.0 * float(value[0])


def _feature(
    name: str, what: str, nominal: _Node, definition: _Node, units: _Units, *, inward: bool
) -> Feature:
    kind = _KINDS[what]
    normal = _vector(_child(nominal, "Normal"), "Normal")
    direction, length, width = None, None, None
    if what == "CircleFeature":
        place = units.place_mm(_child(nominal, "Location"), "Location")
        radius = units.mm(_child(definition, "Diameter"), "Diameter") / 2
    else:
        line = _child(nominal, "CenterLine")
        place = units.place_mm(_child(line, "Point"), "Point of the CenterLine")
        direction = _vector(_child(line, "Vector"), "Vector of the CenterLine")
        length = units.mm(_child(definition, "Length"), "Length")
        across = "Diameter" if what == "ElongatedCircleFeature" else "Width"
        width = units.mm(_child(definition, across), across)
        radius = width / 2
        ends = _child(definition, "EndType")
        kind, radius = _ended("".join(ends.itertext()).strip() if ends is not None else "", radius)
    return listed_feature(
        name=name,
        kind=kind,
        place_mm=place,
        normal=0.0 - normal if inward else normal,
        direction=direction,
        radius_mm=radius,
        length_mm=length,
        width_mm=width,
    )


def _ended(ends: str, radius_mm: float) -> tuple[FeatureKind, float]:
    """Return the kind of a slot with such ends, and its radius."""
    if ends.upper() in {"", "ROUND"}:
        return "slot", radius_mm
    if ends.upper() == "FLAT":
        return "pocket", 0.0
    msg = f"expected a slot with ROUND or FLAT ends, got {ends!r}"
    raise FeatureError(msg)


def _name(node: _Node) -> str:
    """Return a node's name without its namespace."""
    return str(node.tag).rpartition("}")[2]


def _child(node: _Node | None, name: str) -> _Node | None:
    return None if node is None else next((each for each in node if _name(each) == name), None)


def _children(root: _Node, group: str) -> list[_Node]:
    """Return the members of a group of the document's features."""
    found = _child(_child(root, "Features"), group)
    return [] if found is None else list(found)


def _text(node: _Node | None) -> str:
    return "" if node is None else (node.text or "").strip()


def _floats(node: _Node | None) -> NDArray[np.float64]:
    """Return the numbers of a node, without any where one is none."""
    try:
        values = np.array([float(word) for word in _text(node).split()])
    except ValueError:
        return np.zeros(0)
    return values if np.isfinite(values).all() else np.zeros(0)


def _vector(node: _Node | None, what: str) -> NDArray[np.float64]:
    values = _floats(node)
    if values.size != 3:
        msg = f"expected three numbers as {what}, got {_text(node)!r}"
        raise FormatError(msg)
    return values
