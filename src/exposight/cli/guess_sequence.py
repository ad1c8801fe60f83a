"""``exposight decode --guess``: a sequence's file from the frames alone."""

from dataclasses import replace
from pathlib import Path

from exposight import imaging
from exposight.cli.result import Result, Written, fact
from exposight.files import write_durably
from exposight.geometry import CalibrationKeys, read_projector_camera
from exposight.imaging.frame_files import Alignment
from exposight.imaging.guessing import Guess, guess_sequence
from exposight.imaging.unknown_recording import read_unknown_recording
from exposight.tables import Column, Table


def guessed(
    folder: Path,
    calibration: Path | None,
    projector_size: tuple[int, int] | None,
    keys: CalibrationKeys | None = None,
    extrinsics: Path | None = None,
) -> Guess:
    """Propose a sequence for the frames of a folder; a calibration tells the projector's size.

    Raises
    ------
    ExposightError
        If the frames or the calibration cannot be read, or nothing can be told.
    """
    recording = read_unknown_recording(folder)
    if calibration is not None:
        rig = read_projector_camera(
            calibration,
            keys,
            more=extrinsics,
            image_size=recording.stack.image_shape[::-1],
            projector_size=projector_size,
        )
        projector_size = rig.projector.width, rig.projector.height
    guess = guess_sequence(
        recording.stack, projector_size=projector_size, file_pattern=recording.file_pattern
    )
    alignment: Alignment = "high" if recording.is_high else "low"
    return replace(guess, sequence=replace(guess.sequence, alignment=alignment))


def guess_result(folder: Path, guess: Guess, output: Path | None) -> Result:
    """Return what a guess rests on, and write its sequence's file."""
    text = imaging.sequence_to_toml(guess.sequence)
    files: tuple[Written, ...] = ()
    if output is not None:
        files = (Written.at(output, "sequence"),)
        write_durably(output, text.encode())
    return Result(
        title=f"{folder}: what the frames seem to show",
        facts=(fact("sequence", text, ""),),
        tables=(guess_table(guess),),
        notes=() if files else ("nothing was written: --output keeps the sequence, as .toml",),
        files=files,
        next_step=f"decode {folder} -c calibration.xml -s {output}" if output else "",
    )


def guess_table(guess: Guess) -> Table:
    """Return what was found, how sure it is, and why."""
    return Table.of(
        "guess",
        (
            {"what": each.what, "found": each.found, "sure": each.sure, "why": each.why}
            for each in guess.findings
        ),
        (
            Column(name="what"),
            Column(name="found", wraps=True),
            Column(name="sure", label="sure %", scale=100, decimals=0),
            Column(name="why", wraps=True),
        ),
    )
