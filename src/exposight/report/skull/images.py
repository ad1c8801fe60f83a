"""Pictures of the recording: features' rings on the stripe image, and three exposures side by side.

The pictures only show what the result holds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exposight.report.colours import P_NORM_SCALE, scale_rgb
from exposight.report.images import (
    blend,
    grey_picture,
    jpeg,
    marked_legend,
    marked_picture,
    mask_edge,
    p_norm_legend,
    png,
    zoomable,
)
from exposight.report.markup import escape, figure, image_tag, number
from exposight.report.skull.selection import (
    nominal_capture,
    object_crop,
    ring_values,
    visible_views,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.demo import SkullResult


_FILL_OPACITY = 0.22
_EDGE_OPACITY = 0.95


def ring_picture(result: SkullResult) -> NDArray[np.uint8]:
    """Draw the masks of all visible features, coloured by p_norm, on the nominal stripe image.

    Returns
    -------
    (rows, columns, 3) ndarray of uint8
        Red, green, blue; the whole image.
    """
    capture = nominal_capture(result)
    picture = grey_picture(capture)
    values = ring_values(result, capture.exposure_ms)
    for view in visible_views(result):
        p_norm = values.get(view.feature.name)
        if p_norm is None:
            continue
        colour = scale_rgb(P_NORM_SCALE, p_norm)
        edge = mask_edge(view.rows, view.columns)
        blend(picture, view.rows, view.columns, colour, _FILL_OPACITY)
        blend(picture, view.rows[edge], view.columns[edge], colour, _EDGE_OPACITY)
    return np.rint(picture).astype(np.uint8)


def ring_figure(number_: int, result: SkullResult) -> str:
    """Return the figure of the stripe image with the rings."""
    capture = nominal_capture(result)
    crop = object_crop(result)
    picture = crop.of(ring_picture(result))
    tag = image_tag(
        png(picture),
        "image/png",
        "Stripe image with the rings of all features, coloured by p_norm",
        (crop.width, crop.height),
    )
    caption = (
        f"The stripe image at the nominal {number(capture.exposure_ms)} ms with the rings in which "
        "brightness is averaged and points are counted, coloured by <i>p</i><sub>norm</sub>: see "
        "that they lie on smooth surface, and that nearly every pixel gave a point (yellow), for "
        "features were placed where this very cloud is whole. Cropped to the object, brightened "
        "for display."
    )
    return figure(number_, zoomable(tag), caption, p_norm_legend())


def sweep_figure(number_: int, result: SkullResult) -> str:
    """Return the figure of the sweep's captures side by side, clipped and missing pixels marked."""
    crop = object_crop(result)
    pictures = []
    for capture in result.sweep:
        picture = crop.of(marked_picture(capture))
        origin = "emulated" if capture.emulated else "recorded"
        title = f"{number(capture.exposure_ms)} ms, {origin}"
        tag = image_tag(
            jpeg(picture),
            "image/jpeg",
            f"Stripe image at {title}; clipped pixels red, pixels without a point blue",
            (crop.width, crop.height),
        )
        pictures.append(f"<div>{tag}<p>{escape(title)}</p></div>")
    caption = (
        "Three steps of the exposure sweep: see how dark surfaces lose their points where the "
        "exposure is short, and bright ones where it is long. The fringes move from frame to "
        "frame, so a pixel that is blue here may be clipped in another frame. Same crop and "
        "brightening as above."
    )
    content = f'<div class="side">{"".join(pictures)}</div>'
    return figure(number_, content, caption, marked_legend())
