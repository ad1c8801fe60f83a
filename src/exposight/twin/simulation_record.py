"""What a campaign's folder tells of its simulation, so that only the same one goes on in it.

Beside the campaign's own files lie the plan, to be read or carried out again, and a description of
whatever else decides the captures' bytes.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from exposight.cell.documents import StrictDocument, sealed_json, sha256_of, unseal_json
from exposight.durable import write_durably
from exposight.errors import InputError
from exposight.twin.plan_file import plan_to_toml, read_plan

if TYPE_CHECKING:
    from pathlib import Path

    from exposight.twin.plan import MeasuringPlan
    from exposight.twin.scene import Scene

__all__ = ["PLAN_FILE", "RECORD_FILE", "keep_record"]

PLAN_FILE, RECORD_FILE = "plan.toml", "simulation.json"

RECORD_FORMAT = "exposight simulation"
RECORD_VERSION = 1

_Checksum = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _RecordDocument(StrictDocument):
    format: Literal["exposight simulation"]
    version: int
    plan_sha256: _Checksum
    scene_sha256: _Checksum
    rings_only: bool


def keep_record(
    folder: Path, *, plan: MeasuringPlan, scene: Scene, rings_only: bool, n_captures: int
) -> None:
    """Record a simulation in a campaign's folder, or check that it is the one on record.

    Parameters
    ----------
    folder : Path
        The campaign's folder, with its writer open.
    plan : MeasuringPlan
        From where and for how long is measured.
    scene : Scene
        What is measured.
    rings_only : bool
        Whether only the neighbourhoods of the features' rings are taken.
    n_captures : int
        How many captures are there already.

    Raises
    ------
    InputError
        If the captures there come from another plan, scene or extent, or were not simulated.
    FileError
        If the record is damaged, or the disk refuses.
    """
    plan_toml = plan_to_toml(plan).encode()
    document = _RecordDocument(
        format="exposight simulation",
        version=RECORD_VERSION,
        plan_sha256=sha256_of(plan_toml),
        scene_sha256=_scene_sha256(scene),
        rings_only=rings_only,
    )
    path = folder / RECORD_FILE
    if n_captures == 0:
        write_durably(folder / PLAN_FILE, plan_toml)
        write_durably(path, sealed_json(document))
        return
    if not path.is_file():
        msg = (
            f"the campaign in {folder} has {n_captures} captures and no {RECORD_FILE}: they were "
            "not simulated; choose another folder"
        )
        raise InputError(msg)
    known = unseal_json(
        _RecordDocument,
        path.read_bytes(),
        format_name=RECORD_FORMAT,
        newest=RECORD_VERSION,
        source=str(path),
    )
    difference = _difference(known, document, folder, plan)
    if difference:
        msg = (
            f"the campaign in {folder} was simulated with {difference}; go on with that, or choose "
            "another folder"
        )
        raise InputError(msg)


def _difference(
    known: _RecordDocument, wanted: _RecordDocument, folder: Path, plan: MeasuringPlan
) -> str:
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
    return ""


def _scene_sha256(scene: Scene) -> str:
    checksum = hashlib.sha256()
    for array in (scene.vertices, scene.faces, scene.face_finish):
        checksum.update(str(array.shape).encode())
        checksum.update(array.tobytes())
    return checksum.hexdigest()
