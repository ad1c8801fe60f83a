"""Where a model's training poses lie."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exposight.statistics import inside_box

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.models import TrainedModel


def inside_training_poses(model: TrainedModel, inputs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which inputs' poses lie inside the box of the training poses, whatever their i_avg.

    Parameters
    ----------
    model : TrainedModel
        Its training rows span the box.
    inputs : (n, d) ndarray
        Rows of the model's inputs, in their units.

    Returns
    -------
    (n,) ndarray of bool
        True everywhere for a model that reads no pose.
    """
    pose = [i for i, name in enumerate(model.specification.inputs) if name != "i_avg"]
    if not pose:
        return np.ones(len(inputs), dtype=np.bool_)
    return inside_box(model.process.x[:, pose], inputs[:, pose])
