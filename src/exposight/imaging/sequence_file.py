"""Pattern sequences as users write them, in TOML.

::

    name = "my sensor"
    projector_width = 1824
    projector_height = 1140
    bit_depth = 8                  # 8, 12 or 16
    file_pattern = "*.png"
    white_frame = 0                # both or neither
    black_frame = 1

    [columns.gray_code]            # and likewise [rows.gray_code]
    frames = [2, 3, 4, 5, 6, 7, 8, 9, 10, 11]    # most significant bit first
    inverse_frames = []
    code_width = 2                 # projector px

    [[columns.fringes]]            # from few periods to many; with or without gray_code
    periods = 16
    frames = [12, 13, 14]
    shifts_deg = [0, 120, 240]     # equal steps if left out
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from exposight.errors import FormatError, ImageError, MissingFileError, did_you_mean
from exposight.files.document_faults import faults
from exposight.imaging.frames import BitDepth
from exposight.imaging.sequences import (
    SEQUENCE_PRESETS,
    Fringe,
    GrayCode,
    PatternSequence,
    PhaseShift,
)

_Frame = Annotated[int, Field(ge=0)]
_STRICT = ConfigDict(extra="forbid", frozen=True)


class _GrayCodeTable(BaseModel):
    model_config = _STRICT
    frames: tuple[_Frame, ...]
    inverse_frames: tuple[_Frame, ...] = ()
    code_width: int = 1


class _FringeTable(BaseModel):
    model_config = _STRICT
    periods: float
    frames: tuple[_Frame, ...]
    shifts_deg: tuple[float, ...] = ()


class _AxisTable(BaseModel):
    model_config = _STRICT
    gray_code: _GrayCodeTable | None = None
    fringes: tuple[_FringeTable, ...] = ()

    def coding(self, axis: str) -> GrayCode | PhaseShift:
        gray = GrayCode(**self.gray_code.model_dump()) if self.gray_code else None
        if self.fringes:
            fringes = tuple(Fringe(**fringe.model_dump()) for fringe in self.fringes)
            return PhaseShift(fringes=fringes, gray_code=gray)
        if gray is None:
            msg = f"[{axis}] needs a gray_code table, fringes, or both"
            raise ImageError(msg)
        return gray


class _SequenceTable(BaseModel):
    model_config = _STRICT
    name: str
    projector_width: int
    projector_height: int
    columns: _AxisTable | None = None
    rows: _AxisTable | None = None
    white_frame: _Frame | None = None
    black_frame: _Frame | None = None
    bit_depth: BitDepth = 8
    file_pattern: str = "*.png"


def read_sequence(path: str | Path) -> PatternSequence:
    """Read a pattern sequence from a TOML file (see the module's docstring).

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is not TOML, a key is unknown, missing or of the wrong type, or the pieces do not
        fit together.
    """
    path = Path(path)
    if not path.is_file():
        msg = f"{path}: no such pattern sequence; expected a TOML file"
        raise MissingFileError(msg)
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        msg = f"{path}: not TOML: {error}"
        raise FormatError(msg) from error
    try:
        table = _SequenceTable.model_validate(raw)
        return PatternSequence(
            name=table.name,
            projector_width=table.projector_width,
            projector_height=table.projector_height,
            columns=table.columns.coding("columns") if table.columns else None,
            rows=table.rows.coding("rows") if table.rows else None,
            white_frame=table.white_frame,
            black_frame=table.black_frame,
            bit_depth=table.bit_depth,
            file_pattern=table.file_pattern,
        )
    except ValidationError as error:
        msg = f"{path}: not a pattern sequence: {faults(error, raw)}"
        raise FormatError(msg) from error
    except ImageError as error:
        msg = f"{path}: {error}"
        raise FormatError(msg) from error


def sequence_named_or_read(name_or_path: str | Path) -> PatternSequence:
    """Return the pattern sequence that a preset's name or the path of a TOML file stands for.

    Parameters
    ----------
    name_or_path : str or path
        A key of `SEQUENCE_PRESETS`, or a TOML file.

    Raises
    ------
    ImageError
        If it is neither.
    FileError
        If the file cannot be read as a sequence.
    """
    name, path = str(name_or_path), Path(name_or_path)
    if name in SEQUENCE_PRESETS:
        return SEQUENCE_PRESETS[name]
    if path.is_file() or path.suffix.lower() == ".toml":
        return read_sequence(path)
    msg = (
        f"no pattern sequence '{name}': expected one of the presets "
        f"{', '.join(SEQUENCE_PRESETS)}, or a TOML file that says what each frame shows"
    )
    raise ImageError(msg + did_you_mean(name, SEQUENCE_PRESETS))


def sequence_to_toml(sequence: PatternSequence) -> str:
    """Return a pattern sequence as TOML, for `read_sequence` to read back.

    Parameters
    ----------
    sequence : PatternSequence
        What the frames of a recording mean.
    """
    lines = [
        f"{name} = {_toml_value(getattr(sequence, name))}"
        for name in (
            *("name", "projector_width", "projector_height", "bit_depth", "file_pattern"),
            *("white_frame", "black_frame"),
        )
        if getattr(sequence, name) is not None
    ]
    for axis, coding, _ in sequence.axes():
        gray = coding if isinstance(coding, GrayCode) else coding.gray_code
        if gray is not None:
            lines += ["", f"[{axis}.gray_code]", *_toml_keys(gray)]
        for fringe in coding.fringes if isinstance(coding, PhaseShift) else ():
            lines += ["", f"[[{axis}.fringes]]", *_toml_keys(fringe)]
    return "\n".join(lines) + "\n"


def _toml_keys(coding: GrayCode | Fringe) -> list[str]:
    return [f"{name} = {_toml_value(value)}" for name, value in asdict(coding).items()]


def _toml_value(value: object) -> str:
    """Return a text, a number or a list of numbers as TOML, which writes them as JSON does."""
    return json.dumps(value, ensure_ascii=False)
