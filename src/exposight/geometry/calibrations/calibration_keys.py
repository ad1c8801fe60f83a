"""Which nodes of a calibration file are what, where the caller says it: ``--keys``."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Literal, Self, get_args

from exposight.errors import AmbiguousError, FormatError, InputError, did_you_mean
from exposight.geometry.calibrations.calibration_nodes import CalibrationNodes

Direction = Literal["projector_from_camera", "camera_from_projector",
                    "second_from_first", "first_from_second"]  # fmt: skip
NONE = "none"
"""In place of coefficients' node: this lens has no distortion."""


@dataclass(frozen=True, kw_only=True)
class CalibrationKeys:
    """Names of the nodes in a calibration file; what is None is recognised by its shape.

    Parameters
    ----------
    camera_matrix, camera_distortion : str, optional
        Of the camera, or the first of two. Distortion ``none`` says that the lens has none.
    projector_matrix, projector_distortion : str, optional
        Of the projector.
    second_matrix, second_distortion : str, optional
        Of the second camera.
    rotation, translation : str, optional
        Of the transform between both; 3×3 and 3 numbers, mm.
    pose : str, optional
        The same as one node of 4×4 or 3×4 numbers.
    direction : str, optional
        What the transform takes points from and to: ``projector_from_camera`` or
        ``second_from_first`` (X₂ = R·X₁ + T, OpenCV's), or the inverse of one.
    camera_size, projector_size, second_size : str, optional
        One node of two numbers, or two nodes as ``WIDTH+HEIGHT``.

    Raises
    ------
    InputError
        If the direction is none of those, or a projector and a second camera are named.
    """

    camera_matrix: str | None = None
    camera_distortion: str | None = None
    projector_matrix: str | None = None
    projector_distortion: str | None = None
    second_matrix: str | None = None
    second_distortion: str | None = None
    rotation: str | None = None
    translation: str | None = None
    pose: str | None = None
    direction: Direction | None = None
    camera_size: str | None = None
    projector_size: str | None = None
    second_size: str | None = None

    def __post_init__(self) -> None:
        if self.direction is not None and self.direction not in get_args(Direction):
            known = get_args(Direction)
            msg = f"direction must be {' or '.join(known)}, got {self.direction!r}"
            raise InputError(msg + did_you_mean(self.direction, known))
        if self.projector_matrix and self.second_matrix:
            msg = (
                "keys name a projector_matrix and a second_matrix; one calibration has one of both"
            )
            raise InputError(msg)
        if self.pose and (self.rotation or self.translation):
            msg = "keys name a pose, and rotation or translation; give one or the other"
            raise InputError(msg)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the keys of a text such as ``camera_matrix=Kleft,rotation=R``.

        Raises
        ------
        InputError
            If it is no such list, or an entry is unknown or there twice.
        """
        known = [entry.name for entry in fields(cls)]
        # Names of nodes may hold commas and blanks; entries begin with a word and "=".
        parts = [part.strip() for part in re.split(r",(?=\s*\w+\s*=)", text) if part.strip()]
        given: dict[str, str] = {}
        for part in parts:
            name, equals, node = (each.strip() for each in part.partition("="))
            if not equals or not node or name not in known:
                msg = (
                    f"keys are written as ENTRY=NODE,…, ENTRY one of {', '.join(known)}, got "
                    f"{part!r}{did_you_mean(name, known)}"
                )
                raise InputError(msg)
            if name in given:
                msg = f"the keys say {name} twice"
                raise InputError(msg)
            given[name] = node
        return cls(**given)  # type: ignore[arg-type]  # the direction is checked above


def ask_which(
    file: CalibrationNodes, question: str, entry: str, answers: Sequence[str]
) -> AmbiguousError | FormatError:
    """Return the error that asks which node is meant, with the ``--keys`` that answer it.

    Parameters
    ----------
    file : CalibrationNodes
    question : str
    entry : str
        The key that answers; empty where the answers hold theirs.
    answers : sequence of str
        Nodes that fit. Where there is none, it is an error of the file.
    """
    if not answers:
        return FormatError(f"{file.path}: {question} {file.listed()}")
    keys = [f"--keys {entry}={each}" if entry else f"--keys {each}" for each in answers[:8]]
    quoted = [f"--keys '{each[7:]}'" if " " in each[7:] else each for each in keys]
    msg = (
        f"{file.path}: {question} Say which it is: {' or '.join(quoted)} (in Python "
        "keys=CalibrationKeys(…))"
    )
    return AmbiguousError(msg, tuple(keys))
