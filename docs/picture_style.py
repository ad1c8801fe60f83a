"""What all pictures in docs/pictures share: colours, fonts and how they are saved."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
from PIL import Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = Path(__file__).parent / "pictures"
ACCENT, ACCENT_2, ACCENT_3 = "#0072b2", "#d55e00", "#009e73"  # told apart by colour-blind eyes
INK, QUIET = "#222222", "#888888"


def set_style() -> None:
    """Set fonts and axes for all pictures."""
    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})


def save(figure: Figure, name: str, dpi: int = 160) -> None:
    """Save a picture in 256 colours, without anything in it that differs from run to run."""
    PICTURES.mkdir(exist_ok=True)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=dpi, metadata={"Software": None})
    with Image.open(drawn) as image:
        few = image.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    few.save(PICTURES / f"{name}.png", optimize=True)
