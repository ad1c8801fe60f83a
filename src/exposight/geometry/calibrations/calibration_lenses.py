"""Whose a calibration's matrices, coefficients and sizes are: by keys, maps, or names."""

from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError
from exposight.files.reading import recognised
from exposight.geometry.calibrations import calibration_shapes as shapes
from exposight.geometry.calibrations.calibration_names import (
    affinity,
    group_of,
    is_projector,
    shared_maps,
    told_apart,
    words,
)
from exposight.geometry.calibrations.calibration_nodes import (
    NONE,
    CalibrationKeys,
    CalibrationNodes,
    ask_which,
)

Device: TypeAlias = Literal["camera", "second", "projector"]
"""The camera or the first of two, the second camera, the projector; ``KEY_matrix`` of the keys."""
SecondDevice: TypeAlias = Literal["camera", "projector"]


class Lens(NamedTuple):
    """A camera matrix of a file.

    Parameters
    ----------
    name : str
        Its node.
    matrix : (3, 3) ndarray, px
    words : frozenset of str
        Those of its name that the other device's has not.
    """

    name: str
    matrix: NDArray[np.float64]
    words: frozenset[str]


def find_lenses(
    file: CalibrationNodes, keys: CalibrationKeys, second: SecondDevice | None
) -> dict[Device, Lens]:
    """Return the camera's matrix, and the second camera's or the projector's; the camera's first.

    Raises
    ------
    FormatError
        If there is none, one is transposed, or it is the projector's alone.
    AmbiguousError
        If the names do not tell which is whose.
    """
    named: dict[Device, str | None] = {
        "camera": keys.camera_matrix,
        "projector": keys.projector_matrix,
        "second": keys.second_matrix,
    }
    found = shapes.camera_matrices(file.nodes)
    chosen = {device: name for device, name in named.items() if name is not None}
    for name in chosen.values():
        found[name] = file.matrix(name, (3, 3))
    if not chosen:
        found |= _transposed(file, found)
    if not found:
        raise FormatError(_none_found(file))
    if not chosen:
        chosen = _devices(file, list(found), second)
    elif "camera" not in chosen:
        rest = [name for name in found if name not in chosen.values()]
        if len(rest) != 1:
            raise ask_which(file, "which node is the camera's matrix?", "camera_matrix", rest)
        chosen["camera"] = rest[0]
    if "second" in chosen and second == "projector":
        chosen["projector"] = chosen.pop("second")
    lenses: dict[Device, Lens] = {}
    for device in sorted(chosen, key=lambda each: each != "camera"):
        name = chosen[device]
        partner = next((each for other, each in chosen.items() if other != device), None)
        own = words(name) if partner is None else told_apart(name, partner).apart[0]
        lenses[device] = Lens(name, found[name], own)
    return lenses


def _devices(
    file: CalibrationNodes, names: list[str], second: SecondDevice | None
) -> dict[Device, str]:
    """Return which camera matrix is whose, by the names."""
    if len(names) == 1:
        if is_projector(names[0]):
            msg = (
                f"{file.path}: {names[0]} is a projector's matrix by its name, and no other is a "
                f"camera's; {file.listed()}. If it is the camera's, say --keys "
                f"camera_matrix={names[0]}"
            )
            raise FormatError(msg)
        return {"camera": names[0]}
    if len(names) > 2:
        question = f"{len(names)} camera matrices, {', '.join(names)}; which is the camera's?"
        raise ask_which(file, question, "camera_matrix", names)
    roles = told_apart(*names).roles
    if roles is None:
        others = [each for each in ("projector", "second") if (each == "second", second) not in
                  {(True, "projector"), (False, "camera")}]  # fmt: skip
        answers = [
            f"camera_matrix={one},{other}_matrix={two}"
            for other in others
            for one, two in (names, names[::-1])
        ]
        if second is None:  # or one camera alone
            answers += [f"camera_matrix={name}" for name in names]
        question = f"the names {names[0]} and {names[1]} do not tell which device is which."
        raise ask_which(file, question, "", answers)
    told = dict(zip(roles, names, strict=True))
    if "projector" not in told:
        return {"camera": told["first"], "second": told["second"]}
    if second == "camera":
        msg = f"{file.path}: expected two cameras, got a camera and a projector"
        raise FormatError(msg)
    return {"camera": told["camera"], "projector": told["projector"]}


def _transposed(
    file: CalibrationNodes, found: Mapping[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """Return Open3D's ``intrinsic_matrix``: nine numbers, column by column.

    Raises
    ------
    FormatError
        If another matrix is transposed: MATLAB's, which count pixels from 1, are, too.
    """
    turned = {
        name: matrix.T
        for name, node in file.nodes.items()
        if (matrix := shapes.square(node, 3)) is not None
        and matrix[2, :2].any()
        and shapes.is_camera_matrix(matrix.T)
    }
    others = [name for name in turned if name.rpartition(".")[2] != "intrinsic_matrix"]
    others += [name for name in turned if np.ndim(file.nodes[name]) != 1 or found]
    if others:
        msg = (
            f"{file.path}: '{others[0]}' is a camera matrix transposed, and rotations may "
            "be too: transpose them in the file, or export OpenCV's matrices"
        )
        raise FormatError(msg)
    for name in turned:
        recognised(file.path, f"{name} is read column by column, as Open3D writes it")
    return turned


def _none_found(file: CalibrationNodes) -> str:
    if shapes.rotations(file.nodes) and shapes.translations(file.nodes):
        return (
            f"{file.path}: a rotation and a translation and no camera matrix; name the file with "
            "the camera matrices first, and this one after it"
        )
    return (
        f"{file.path}: no camera matrix, 3×3 with focal lengths in px and a last row 0 0 1, nor "
        f"fx, fy, cx, cy; {file.listed()}"
    )


# -- coefficients -------------------------------------------------------------------------------


class Coefficients(NamedTuple):
    """A lens's distortion coefficients; no name where the file, or the caller, says it has none."""

    numbers: NDArray[np.float64]
    name: str | None


def find_coefficients(
    file: CalibrationNodes, keys: CalibrationKeys, lenses: Mapping[Device, Lens]
) -> dict[Device, Coefficients]:
    """Return the distortion coefficients of each lens.

    Raises
    ------
    AmbiguousError
        If two fit a lens, or one has none although the file has some.
    """
    found, others = shapes.coefficient_vectors(file.nodes)
    result: dict[Device, Coefficients] = {}
    for device in lenses:
        name = getattr(keys, f"{device}_distortion")
        if name == NONE:
            result[device] = Coefficients(np.zeros(0), None)
        elif name is not None:
            result[device] = Coefficients(file.matrix(name).reshape(-1), name)
            found.pop(name, None)
            others.pop(name, None)
    left: list[Device] = [device for device in lenses if device not in result]
    if not found and len(others) == len(left) == 2:  # V1 and V2 beside A1 and A2
        named_alike = {
            n: v for n, v in others.items() if any(words(n) & lenses[d].words for d in left)
        }
        found = named_alike if len(named_alike) == 2 else found
    for device, name in _matched(file, left, lenses, found).items():
        result[device] = Coefficients(found.pop(name), name)
    without = [device for device in lenses if device not in result]
    if without and (found or others or any(each.numbers.size for each in result.values())):
        question = f"no lens distortion is named for {lenses[without[0]].name}; {file.listed()}."
        names = [*list(found or others)[:6], NONE]
        raise ask_which(file, question, f"{without[0]}_distortion", names)
    return result | {device: Coefficients(np.zeros(0), None) for device in without}


def _matched(
    file: CalibrationNodes,
    devices: list[Device],
    lenses: Mapping[Device, Lens],
    found: Mapping[str, NDArray[np.float64]],
) -> dict[Device, str]:
    """Return the coefficients that fit each lens by their names, and no other lens as well."""

    def score(name: str, device: Device) -> float:
        lens = lenses[device]
        return affinity(name, lens.name, lens.words)

    fits: dict[Device, list[str]] = {device: [] for device in devices}
    if len(lenses) == 1 and devices:
        (device,) = devices
        best = max((score(name, device) for name in found), default=0.0)
        fits[device] = [name for name in found if score(name, device) == best]
    else:
        for name in found:
            best = max(score(name, device) for device in lenses)
            winners = [device for device in lenses if score(name, device) == best]
            if len(winners) == 1 and winners[0] in fits:
                fits[winners[0]].append(name)
        rest = [name for name in found if not any(name in names for names in fits.values())]
        without = [device for device, names in fits.items() if not names]
        if len(rest) == len(without) == 1:
            fits[without[0]] = rest
    for device, names in fits.items():
        if len(names) > 1:
            question = f"{', '.join(names)} could be the distortion of {lenses[device].name}."
            raise ask_which(file, question, f"{device}_distortion", names)
    return {device: names[0] for device, names in fits.items() if names}


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
