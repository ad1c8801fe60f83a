import pytest

from exposight.errors import ImageError
from exposight.imaging import (
    SEQUENCE_PRESETS,
    AxisCoding,
    Fringe,
    GrayCode,
    PatternSequence,
    sequence_named_or_read,
)

COARSE = Fringe(periods=1, frames=(0, 1, 2))
FINE = Fringe(periods=16, frames=(3, 4, 5))
GRAY = AxisCoding(gray_code=GrayCode(frames=(0, 1, 2, 3), inverse_frames=(4, 5, 6, 7)))


@pytest.mark.parametrize(
    ("name", "n_frames"), [("skull_gray", 12), ("skull_2x3", 6), ("board", 42), ("foam", 32)]
)
def test_presets_use_all_their_frames(name, n_frames):
    assert sequence_named_or_read(name).n_frames == n_frames


def test_unknown_preset_lists_the_known():
    with pytest.raises(ImageError, match=r"'door': expected one of the presets skull_gray, "):
        sequence_named_or_read("door")


def test_presets_cannot_be_changed():
    with pytest.raises(TypeError):
        SEQUENCE_PRESETS["mine"] = sequence_named_or_read("board")


def test_steps_are_equal_by_default():
    assert Fringe(periods=1, frames=(0, 1, 2, 3)).shifts_deg == (0.0, 90.0, 180.0, 270.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: GrayCode(frames=()), "needs 1 to 16 frames, got 0"),
        (lambda: GrayCode(frames=(0, 1), inverse_frames=(2,)), "as many inverse frames or none"),
        (lambda: GrayCode(frames=(0,), code_width=0), "width must be at least 1"),
        (lambda: Fringe(periods=0, frames=(0, 1, 2)), "periods must be above 0"),
        (lambda: Fringe(periods=1, frames=(0, 1)), "at least 3 steps, got 2"),
        (lambda: Fringe(periods=1, frames=(0, 1, 2), shifts_deg=(0, 1)), "as many shifts, got 2"),
        (
            lambda: Fringe(periods=1, frames=(0, 1, 2), shifts_deg=(0, 180, 360)),
            "at least three different shifts",
        ),
        (lambda: AxisCoding(fringes=()), "need a gray_code table, fringes, or both"),
        (lambda: AxisCoding(fringes=(FINE, FINE)), "two fringes of 16 periods: give one"),
        (lambda: GrayCode(frames=(0, 1), first_code=4), "from 0 to 3, got 4"),
        (lambda: GrayCode(frames=(0, 1), code="grey"), 'is "gray" or "binary", got \'grey\''),
        (
            lambda: GrayCode(frames=(0, 1), code_width=3, complementary_frame=2),
            "of even width, got a gray code of 3 px",
        ),
        (
            lambda: GrayCode(frames=(0, 1), code="binary", code_width=2, complementary_frame=2),
            "got a binary code",
        ),
    ],
)
def test_bad_codings(build, message):
    with pytest.raises(ImageError, match=message):
        build()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "columns, its rows, or both"),
        ({"columns": GRAY, "projector_width": 0}, "a projector has 1 to 100000 px"),
        ({"columns": GRAY, "projector_height": 10**23}, "a projector has 1 to 100000 px"),
        (
            {"columns": GRAY, "bit_depth": 17},
            "a bit depth must be a whole number from 8 to 16, got 17",
        ),
        ({"columns": GRAY, "unused_frames": (3,)}, r"\[3\] are used more than once"),
        ({"columns": GRAY, "saturation_level": 300}, "from 1 to 255, .* got 300"),
        ({"columns": GRAY, "white_frame": 9}, "given together or not at all"),
        (
            {"columns": AxisCoding(gray_code=GrayCode(frames=(0, 1, 2, 3)))},
            "of the columns has no inverse frames",
        ),
        ({"columns": AxisCoding(fringes=(FINE,))}, "16 periods repeat every 1 px of 16;"),
        ({"columns": GRAY, "projector_gamma": 0}, "projector_gamma must be from 0.1 to 10"),
        ({"columns": GRAY, "pattern_contrast": 1.5}, "pattern_contrast must be above 0"),
        ({"columns": GRAY, "rows": GRAY}, r"but \[0, 1, .*\] are used more than once"),
        ({"columns": GRAY, "projector_width": 17}, "covers 16 px of a projector of 17 px"),
        (
            {
                "columns": AxisCoding(
                    fringes=(Fringe(periods=32, frames=(8, 9, 10)),),
                    gray_code=GrayCode(frames=(0,), inverse_frames=(1,), code_width=8),
                )
            },
            "more than the 0.5 px over which the coarsest fringes are unambiguous",
        ),
        (
            {
                "columns": AxisCoding(
                    gray_code=GrayCode(frames=(-1,), inverse_frames=(0,), code_width=16)
                )
            },
            "from 0, got -1",
        ),
    ],
)
def test_bad_sequences(settings, message):
    with pytest.raises(ImageError, match=message):
        PatternSequence(**{"name": "x", "projector_width": 16, "projector_height": 9, **settings})
