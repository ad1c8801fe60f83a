"""Pattern sequences by name, and as users write them in TOML.

::

    name = "my sensor"
    projector_width = 1824
    projector_height = 1140
    bit_depth = 8                  # 8 to 16
    file_pattern = "*.png"
    grey_noise = 1.2               # of 255; found from four steps or more if left out
    white_frame = 0                # both or neither
    black_frame = 1

    [columns.gray_code]            # and likewise [rows.gray_code]
    frames = [2, 3, 4, 5, 6, 7, 8, 9, 10, 11]    # most significant bit first
    inverse_frames = []
    code_width = 2                 # projector px

    [[columns.fringes]]            # in any order; with or without gray_code
    periods = 16
    frames = [12, 13, 14]
    shifts_deg = [0, 120, 240]     # equal steps if left out

docs/formats.md describes every key.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import fields
from pathlib import Path
from types import MappingProxyType

from exposight.errors import ImageError, did_you_mean
from exposight.files import parse_toml, read_text, validate
from exposight.imaging.codings import Fringe, GrayCode
from exposight.imaging.sequences import AxisCoding, PatternSequence


def _frames(first: int, stop: int, step: int = 1) -> tuple[int, ...]:
    return tuple(range(first, stop, step))


def _with_inverses(first: int, stop: int, code_width: int = 1) -> GrayCode:
    """Return a Gray code whose bits each have their inverse in the next frame."""
    return GrayCode(
        frames=_frames(first, stop, 2),
        inverse_frames=_frames(first + 1, stop, 2),
        code_width=code_width,
        first_code=0,
    )


def _foam_axis(size: int, first_fringe: int, gray: tuple[int, int]) -> AxisCoding:
    """Code one axis by fringes of 66.7 and 100 px, three steps δ = 120°, 0°, −120°."""
    shifts = (120.0, 0.0, -120.0)
    fine = _frames(first_fringe, first_fringe + 3)
    coarse = _frames(first_fringe + 3, first_fringe + 6)
    return AxisCoding(
        fringes=(
            Fringe(periods=size / 100, frames=coarse, shifts_deg=shifts),
            Fringe(periods=size * 3 / 200, frames=fine, shifts_deg=shifts),
        ),
        gray_code=_with_inverses(*gray, code_width=100),
    )


SEQUENCE_PRESETS: Mapping[str, PatternSequence] = MappingProxyType(
    {
        "skull_gray": PatternSequence(
            name="SLStudio Gray code, ten of eleven bits",
            projector_width=1824,
            projector_height=1140,
            columns=AxisCoding(
                gray_code=GrayCode(frames=_frames(2, 12), code_width=2, first_code=0)
            ),
            white_frame=0,
            black_frame=1,
        ),
        "skull_2x3": PatternSequence(
            name="SLStudio phase shift, 16 periods and 1, three steps each",
            projector_width=1824,
            projector_height=1140,
            columns=AxisCoding(
                # The fine fringe comes first in this recording.
                fringes=(
                    Fringe(periods=1, frames=(3, 4, 5)),
                    Fringe(periods=16, frames=(0, 1, 2)),
                )
            ),
        ),
        "board": PatternSequence(
            name="OpenCV Gray code with inverse frames, 1024 × 768",
            projector_width=1024,
            projector_height=768,
            columns=AxisCoding(gray_code=_with_inverses(0, 20)),
            rows=AxisCoding(gray_code=_with_inverses(20, 40)),
            white_frame=40,
            black_frame=41,
            file_pattern="graycode_*.png",
        ),
        "foam": PatternSequence(
            name="Gray code of 100 px, fringes of 100 and 66.7 px, both axes of a display",
            projector_width=1920,
            projector_height=1080,
            columns=_foam_axis(1920, 0, (12, 22)),
            rows=_foam_axis(1080, 6, (22, 30)),
            white_frame=30,
            black_frame=31,
            projector_gamma=2.5,  # the coordinate on the wall waves by 0.2 px, without it by 2.6
            file_pattern="pat*.png",
        ),
    }
)
"""Sequences of public recordings, by name."""


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
    what = "pattern sequence in TOML"
    raw = parse_toml(read_text(Path(path), what), path, what)
    return validate(PatternSequence, raw, str(path))


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
    lines = _toml_keys(sequence, without=("columns", "rows"))
    for axis, coding, _ in sequence.axes():
        if coding.mirrored:
            lines += ["", f"[{axis}]", "mirrored = true"]
        if coding.gray_code is not None:
            lines += ["", f"[{axis}.gray_code]", *_toml_keys(coding.gray_code)]
        for fringe in coding.fringes:
            lines += ["", f"[[{axis}.fringes]]", *_toml_keys(fringe)]
    return "\n".join(lines) + "\n"


def _toml_keys(of: PatternSequence | GrayCode | Fringe, without: Collection[str] = ()) -> list[str]:
    """Return a line for each field that is not as it is by default."""
    return [
        f"{field.name} = {_toml_value(getattr(of, field.name))}"
        for field in fields(of)
        if field.name not in without and getattr(of, field.name) != field.default
    ]


def _toml_value(value: object) -> str:
    """Return a text, a number or a list of numbers as TOML, which writes them as JSON does."""
    return json.dumps(value, ensure_ascii=False)
