"""How a plan is carried out: by whom, and what is kept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from exposight.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class CellSettings:
    """How a plan is carried out; none of it changes what is measured, some what is kept.

    Parameters
    ----------
    rings_only : bool
        Trace and decode only the neighbourhoods of the features' rings: p_norm and i_avg are the
        same as from whole frames, images are black and clouds empty elsewhere. Not for stereo
        sensors, whose matching weighs whole rows.
    clouds : bool
        Keep the clouds. Without them every capture is observed when it is taken, and the campaign
        holds its observations (``observations.csv``), which cannot be repeated from it.
    raw_frames : bool
        Keep every frame that a cloud was computed from beside it.
    workers : int
        Processes on this machine that work at the same time; 1 stays in this one.
    cluster : str or None
        Address of a Dask scheduler whose workers do the work instead, as ``tcp://host:8786``. A
        campaign's folder must then be reached by all of them at the same path.
    scene : Path or None
        Folder of an exported scene (`exposight.twin.part.scene_files`); None for the door.

    Raises
    ------
    InputError
        If there is no worker, or there are workers here and a cluster.
    """

    rings_only: bool = False
    clouds: bool = True
    raw_frames: bool = False
    workers: int = 1
    cluster: str | None = None
    scene: Path | None = None

    def __post_init__(self) -> None:
        if self.scene is not None:  # workers may be elsewhere
            object.__setattr__(self, "scene", self.scene.resolve())
        if self.workers < 1:
            msg = f"a simulation needs at least 1 worker, got {self.workers}"
            raise InputError(msg)
        if self.cluster is not None and self.workers != 1:
            msg = (
                f"a simulation is done by processes here or by a cluster, got {self.workers} "
                f"workers and the cluster {self.cluster!r}; choose one"
            )
            raise InputError(msg)
