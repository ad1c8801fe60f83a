"""What a folder tells of the simulation that fills it, so that only the same one goes on in it.

Beside a campaign's own files lie the plan, to be read or carried out again, and a description of
whatever else decides the captures' bytes.
"""

from __future__ import annotations

import hashlib
import socket
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from exposight.errors import FileError, InputError
from exposight.files.documents import DocumentFormat, sha256_of
from exposight.files.durable import write_durably
from exposight.plans import plan_to_toml, read_plan

if TYPE_CHECKING:
    from pathlib import Path

    from exposight.plans import MeasuringPlan
    from exposight.twin.campaign.settings import CellSettings
    from exposight.twin.part import Scene


PLAN_FILE, RECORD_FILE = "plan.toml", "simulation.json"

_Checksum = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


@dataclass(frozen=True, kw_only=True)
class _Record:
    plan_sha256: _Checksum
    scene_sha256: _Checksum
    rings_only: bool
    clouds: bool = True  # in version 1 there was no choice
    raw_frames: bool = False


_RECORD = DocumentFormat("exposight simulation", 2, _Record)
"""2: what is kept of a capture."""


def keep_record(
    folder: Path,
    *,
    plan: MeasuringPlan,
    scene: Scene,
    settings: CellSettings,
    n_captures: int,
    what: str,
) -> str:
    """Record a simulation in the folder that it fills, or check that it is the one on record.

    Parameters
    ----------
    folder : Path
        Locked by this process.
    plan : MeasuringPlan
        From where and for how long is measured.
    scene : Scene
        What is measured.
    settings : CellSettings
        What is taken and kept.
    n_captures : int
        How many captures are there already; the first of them makes the record binding.
    what : str
        What the folder is, for messages.

    Returns
    -------
    str
        Checksum of the record, for `check_record`.

    Raises
    ------
    InputError
        If the captures there come from another plan or scene, others are kept of them, or they
        were not simulated.
    FileError
        If the record is damaged, or the disk refuses.
    """
    plan_toml = plan_to_toml(plan).encode()
    record = _Record(
        plan_sha256=sha256_of(plan_toml),
        scene_sha256=scene_checksum(scene),
        rings_only=settings.rings_only,
        clouds=settings.clouds,
        raw_frames=settings.raw_frames,
    )
    path = folder / RECORD_FILE
    if n_captures == 0:
        write_durably(folder / PLAN_FILE, plan_toml)
        write_durably(path, _RECORD.seal(record))
        return sha256_of(path.read_bytes())
    if not path.is_file():
        msg = (
            f"the {what} in {folder} has {n_captures} captures and no {RECORD_FILE}: they were "
            "not simulated; choose another folder"
        )
        raise InputError(msg)
    content = path.read_bytes()
    known = _RECORD.unseal(content, str(path))
    difference = _difference(known, record, folder, plan)
    if difference:
        msg = (
            f"the {what} in {folder} was simulated with {difference}; go on with that, or choose "
            "another folder"
        )
        raise InputError(msg)
    return sha256_of(content)


def check_record(folder: Path, sha256: str) -> None:
    """Check, in a worker process, that a folder is the one where the simulation is on record.

    Parameters
    ----------
    folder : Path
        The campaign's folder, as the process that began the simulation names it.
    sha256 : str
        What `keep_record` returned there.

    Raises
    ------
    FileError
        If there is no such folder here, or the one here is another.
    """
    path = folder / RECORD_FILE
    try:
        same = sha256_of(path.read_bytes()) == sha256
        found = "another one is there"
    except OSError as error:
        same, found = False, error.strerror or str(error)
    if not same:
        msg = (
            f"the campaign's folder {folder} is not the same on {socket.gethostname()}, where a "
            f"worker is ({RECORD_FILE}: {found}); choose a folder that all workers reach at the "
            "same path, or --observe, which needs none"
        )
        raise FileError(msg)


def _difference(known: _Record, wanted: _Record, folder: Path, plan: MeasuringPlan) -> str:
    if known.plan_sha256 != wanted.plan_sha256:
        other = read_plan(folder / PLAN_FILE)
        differing = [
            own.name for own in fields(plan) if getattr(plan, own.name) != getattr(other, own.name)
        ]
        return f"another plan, differing in {', '.join(differing) or 'a file changed by hand'}"
    if known.scene_sha256 != wanted.scene_sha256:
        return "another scene"
    if known.rings_only != wanted.rings_only:
        return (
            "rings only, not whole frames" if known.rings_only else "whole frames, not rings only"
        )
    if known.clouds != wanted.clouds:
        return "clouds kept, not without" if known.clouds else "no clouds kept, not with them"
    if known.raw_frames != wanted.raw_frames:
        return "raw frames kept, not without" if known.raw_frames else "no raw frames kept"
    return ""


def scene_checksum(scene: Scene) -> str:
    """Return the SHA-256 of a scene's triangles and finishes."""
    checksum = hashlib.sha256()
    for array in (scene.vertices, scene.faces, scene.face_finish):
        checksum.update(str(array.shape).encode())
        checksum.update(array.tobytes())
    return checksum.hexdigest()
