"""``exposight info``: what a file, folder or named plan is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from exposight.cli.output import JsonOption, print_facts, print_json
from exposight.cli.recognise import recognise

_File = Annotated[
    Path,
    typer.Argument(
        metavar="FILE", help="Any file or folder of the method, or a measuring plan's name."
    ),
]


def info_command(file: _File, as_json: JsonOption = False) -> None:
    """Say what a file or folder is, and what is in it.

    Knows campaigns, models, sensors, feature lists, observation tables, point
    clouds, images and folders of frames, calibrations, pattern sequences and
    measuring plans. Campaigns and models are verified against their checksums.

    For example:

      exposight info models/q_k4.exposight-model

      exposight info small
    """
    found = recognise(file)
    if as_json:
        facts = {fact.name.replace(" ", "_"): fact.value for fact in found.facts}
        print_json({"path": file, "kind": found.kind, "facts": facts})
        return
    title = f"{found.kind}, {found.remark}" if found.remark else found.kind
    print_facts(f"{file}: {title}", [(fact.name, fact.text) for fact in found.facts])
