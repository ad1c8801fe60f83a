"""Draw the pictures in docs/pictures: ``make docs``, two to three minutes on two cores.

Those of the simulated cell need nothing; that of the skull needs its recording, and stays as it is
where there is none.
"""

from __future__ import annotations

import sys

from picture_of_brightness import draw_brightness
from picture_of_door import draw_door
from picture_of_exposures import draw_exposures
from picture_of_forecasts import draw_forecasts
from picture_of_recommendation import draw_recommendation
from picture_of_skull import draw_skull
from picture_style import set_style

from exposight.errors import MissingFileError
from exposight.twin.light import SceneTracer
from exposight.twin.part import door


def main() -> None:
    """Draw all pictures."""
    set_style()
    scene = door()
    tracer = SceneTracer(scene)
    draw_door(scene, tracer)
    draw_exposures(scene, tracer)
    draw_brightness(scene)
    draw_forecasts()
    draw_recommendation()
    try:
        draw_skull()
    except MissingFileError as error:
        sys.stderr.write(f"skull.png is not drawn again: {error}\n")


if __name__ == "__main__":
    main()
