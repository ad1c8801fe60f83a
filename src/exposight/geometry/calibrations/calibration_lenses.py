"""Whose a calibration's camera matrices and lens coefficients are: by keys, or by their names."""

from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError
from exposight.files.reading import recognised
from exposight.geometry.calibrations import calibration_shapes as shapes
from exposight.geometry.calibrations.calibration_keys import NONE, CalibrationKeys, ask_which
from exposight.geometry.calibrations.calibration_names import (
    affinity,
    is_projector,
    told_apart,
    words,
)
from exposight.geometry.calibrations.calibration_nodes import CalibrationNodes

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
