"""Which size in a calibration is a device's: by keys, by the map it stands in, or by its name."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from exposight.errors import FormatError
from exposight.geometry.calibrations import calibration_shapes as shapes
from exposight.geometry.calibrations.calibration_keys import CalibrationKeys, ask_which
from exposight.geometry.calibrations.calibration_lenses import Device, Lens
from exposight.geometry.calibrations.calibration_names import group_of, shared_maps, words
from exposight.geometry.calibrations.calibration_nodes import CalibrationNodes

_OFF_CENTRE = 0.08
"""Share of the image by which a principal point is off its middle, where another order fits."""
_OPTIONS = {"projector": "--projector-size", "camera": "--image-size", "second": "--image-size"}
WHOSE = {"projector": "the projector's", "camera": "the images'", "second": "the images'"}


class FoundSize(NamedTuple):
    """Width and height in px, and the nodes that hold them; no names where the caller gave them."""

    size: tuple[int, int]
    names: str


def find_size(
    file: CalibrationNodes,
    keys: CalibrationKeys,
    device: Device,
    lenses: Mapping[Device, Lens],
    given: tuple[int, int] | None,
) -> FoundSize | None:
    """Return the size of a device's image; None where nobody says it.

    Raises
    ------
    FormatError
        If the file and the caller say different ones, or one node's order does not fit.
    AmbiguousError
        If several could be it.
    """
    named: str | None = getattr(keys, f"{device}_size")
    if named is not None:
        return _named(file, named)
    fitting = _fitting(device, lenses, shapes.sizes(file.nodes))
    sizes = dict.fromkeys(
        each.size
        if device == "projector" or each.turned is None
        else _right_way_round(file, each, lenses[device], given)
        for each in fitting
    )
    if len(sizes) > 1 and given is None:
        answers = [each.names.replace(", ", "+") for each in fitting]
        question = f"several sizes could be of {lenses[device].name}."
        raise ask_which(file, question, f"{device}_size", answers)
    if len(sizes) != 1:
        return None if given is None else FoundSize(given, "")
    (size,) = sizes
    if given is not None and tuple(given) != size:
        msg = (
            f"{file.path}: {fitting[0].names} say {size[0]} × {size[1]} px, and {given[0]} × "
            f"{given[1]} px was given for {WHOSE[device]} size; use the calibration of this "
            "resolution"
        )
        raise FormatError(msg)
    return FoundSize(size, fitting[0].names)


def missing_size(device: Device) -> str:
    """Return what to do where nobody says a device's size."""
    return (
        f"{WHOSE[device]} size is not in the file; give its width and height ({_OPTIONS[device]} W "
        f"H), or name its nodes with --keys {device}_size=WIDTH+HEIGHT"
    )


def _named(file: CalibrationNodes, named: str) -> FoundSize:
    if named in file.nodes:
        first, second = file.whole_numbers(named, 2)
        turned = "shape" in words(named)
        return FoundSize((second, first) if turned else (first, second), named)
    wide, plus, high = named.partition("+")
    if not plus:
        file.node(named)  # refuses
    size = (file.whole_numbers(wide, 1)[0], file.whole_numbers(high, 1)[0])
    return FoundSize(size, f"{wide}, {high}")


def _fitting(
    device: Device, lenses: Mapping[Device, Lens], found: list[shapes.SizeNodes]
) -> list[shapes.SizeNodes]:
    """Return the sizes that may be a device's."""
    lens, others = lenses[device], [each for key, each in lenses.items() if key != device]

    def nearer(each: shapes.SizeNodes) -> int:
        """Return by how many maps it is nearer to this device than to the others."""
        first = each.names.partition(", ")[0]
        away = max((shared_maps(first, other.name) for other in others), default=0)
        return shared_maps(first, lens.name) - away

    if others or group_of(lens.name):
        inside = [each for each in found if nearer(each) > 0]
        if inside:
            return [each for each in inside if each.group == group_of(lens.name)] or inside
    found = [each for each in found if nearer(each) == 0]
    light = [each for each in found if shapes.size_role(each) == "projector"]
    if device == "projector":
        return light
    found = [each for each in found if each not in light]
    if len(found) > 1 and others:
        found = [each for each in found if words(each.names) & lens.words] or found
    return [each for each in found if shapes.size_role(each) == "camera"] or found


def _right_way_round(
    file: CalibrationNodes, each: shapes.SizeNodes, lens: Lens, given: tuple[int, int] | None
) -> tuple[int, int]:
    """Return width and height of one node, which must fit the principal point."""
    (width, height), (cx, cy) = each.size, lens.matrix[:2, 2]
    if given is not None and given in {(width, height), (height, width)}:
        return given

    def off(w: int, h: int) -> float:
        return float(np.hypot(cx / w - 0.5, cy / h - 0.5))

    if off(width, height) > _OFF_CENTRE and off(height, width) < 0.5 * off(width, height):
        order = "height, width" if each.turned else "width, height"
        msg = (
            f"{file.path}: {each.names} should be ({order}) by its name, but then the principal "
            f"point ({cx:.0f}, {cy:.0f}) is far from the middle; say which it is: --image-size "
            f"{height} {width} or --image-size {width} {height}"
        )
        raise FormatError(msg)
    return each.size
