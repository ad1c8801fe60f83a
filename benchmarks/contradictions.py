"""Wrong input is caught by what contradicts it: cases, false alarms, cost, and new codings.

Run with ``make bench NAME=contradictions``. The cases are those of `contradictions_cases`; the
recordings lie where the environment variable EXPOSIGHT_REAL_DATA says, else in
``../shared/data/real``, and are left out where there are none.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.bring_folder import coarser_sensor, tilted_poses
from benchmarks.contradictions_cases import CASES, heterodyne_rig, tried
from benchmarks.measuring import Figure, at_most, best_of, publish, say
from benchmarks.plate import flat_plate, many_holes, plate_capture
from benchmarks.rig import Rig, fringe
from benchmarks.sigma_z import sigma_z_ratio
from exposight.cell import ActiveSensor, Capture, sensor_preset
from exposight.contradictions import Contradiction
from exposight.errors import ContradictionError
from exposight.geometry import RigidTransform, read_projector_camera
from exposight.imaging import (
    AxisCoding,
    DecodedMap,
    DecodingLimits,
    FrameStack,
    Fringe,
    PatternSequence,
    decode,
    match_codes,
    read_recording,
    read_sequence,
    rectify,
    sequence_named_or_read,
    triangulate,
)
from exposight.imaging.consistency import frame_contradictions, map_contradiction
from exposight.observing import observe_capture, point_search, view_features
from exposight.observing.capture_checks import capture_contradictions
from exposight.observing.observe import Observer
from exposight.twin import SimulatedCell
from exposight.twin.cell_settings import SimulatedCellSettings

# -- false alarms --------------------------------------------------------------------------------

_FINISHES = ("bare", "primer", "paint", "brushed")
_VIEWS = 8
_EXPOSURES = 8


def simulated_captures() -> tuple[int, list[Contradiction]]:
    """Take captures of the door by both sensors, in all finishes, dark to clipped.

    Returns
    -------
    int
        How many captures were checked, their frames among what is checked.
    list of Contradiction
        What was found in them, and should not.
    """
    found: list[Contradiction] = []
    checked = 0
    for name in ("comet-pro-ae", "rc-visard-65"):
        sensor = coarser_sensor(name)
        for finish in _FINISHES:
            say(f"simulated captures: {name}, {finish}")
            settings = SimulatedCellSettings(
                finish=finish, raw_frames=True, kinematic_share={"": 0.2}
            )
            cell = SimulatedCell(sensor, settings, seed=5)
            sequence = _sequence_of(cell)
            for number, pose in enumerate(
                tilted_poses(sensor, cell.part, _VIEWS, tilt_deg=25.0, seed=3)
            ):
                observer = Observer(cell.part, sensor)
                for exposure_ms in _exposures(sensor):
                    capture = cell.capture(exposure_ms, pose, view=f"v{number}")
                    found += _found_in(capture, observer)
                    found += _found_in_frames(capture, sequence)
                    checked += 1
    return checked, found


def _exposures(sensor: ActiveSensor) -> list[float]:
    low, high = sensor.exposure.min_ms, min(sensor.exposure.max_ms, 500.0)
    return [sensor.nearest_exposure(t) for t in np.geomspace(low, high, _EXPOSURES).tolist()]


def _found_in(capture: Capture, observer: Observer) -> list[Contradiction]:
    before = len(observer.contradictions)
    try:
        observer.observe(capture)
    except ContradictionError as error:
        return list(error.contradictions)
    return list(observer.contradictions[before:])


def _sequence_of(cell: SimulatedCell) -> PatternSequence | None:
    """Return what a cell's raw frames mean; None where they are no stripes."""
    files = cell.campaign_files()
    if "sequence.toml" not in files:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sequence.toml"
        path.write_bytes(files["sequence.toml"])
        return read_sequence(path)


def _found_in_frames(capture: Capture, sequence: PatternSequence | None) -> list[Contradiction]:
    if sequence is None:
        return []
    names = sorted(name for name in capture.attachments if name.startswith("frame-"))
    frames = [
        cv2.imdecode(np.frombuffer(capture.attachments[name], np.uint8), cv2.IMREAD_UNCHANGED)
        for name in names
    ]
    stack = FrameStack(frames=np.array(frames), bit_depth=sequence.bit_depth)
    return list(frame_contradictions(stack, sequence, DecodingLimits()))


_RECORDINGS = (
    ("skull/skull_gray", "skull_gray"),
    ("skull/skull_2x3", "skull_2x3"),
    ("board/capture_0", "board"),
    ("foam/object1", "foam"),
)


def recordings() -> tuple[list[Contradiction], list[Figure]]:
    """Decode the recordings; return what was found and should not, and half-decoded points."""
    folder = Path(os.environ.get("EXPOSIGHT_REAL_DATA", "../shared/data/real"))
    if not folder.is_dir():
        say(f"{folder}: no recordings; what is measured on them is left out")
        return [], []
    found: list[Contradiction] = []
    figures = []
    for place, preset in _RECORDINGS:
        sequence = sequence_named_or_read(preset)
        stack = read_recording(folder / place, sequence)
        found += frame_contradictions(stack, sequence, DecodingLimits())
        if preset == "board":
            figures.append(
                at_most("half_decoded_points", _half_decoded(folder, stack, sequence), 0)
            )
    return found, figures


def _half_decoded(folder: Path, stack: FrameStack, sequence: PatternSequence) -> int:
    """Count points of the board whose column or row was not read."""
    decoded = decode(stack, sequence)
    rig = read_projector_camera(
        folder / "board" / "calibration_result.xml",
        projector_size=(sequence.projector_width, sequence.projector_height),
    )
    cloud = triangulate(
        decoded,
        camera=rig.camera,
        projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
    )
    return int(np.count_nonzero(cloud.valid & ~decoded.valid))


def false_alarms() -> list[Figure]:
    """Count what is found where there is nothing to find."""
    checked, found = simulated_captures()
    recorded, figures = recordings()
    for each in (*found, *recorded):
        say(f"false alarm: {each}")
    return [
        Figure(name="clean_captures", value=checked, mark="≥ 500", met=checked >= 500),
        at_most("false_alarms", len(found) + len(recorded), 0),
        *figures,
    ]


# -- cost ----------------------------------------------------------------------------------------


def overhead() -> list[Figure]:
    """Time all checks of a 4-megapixel capture against decoding and observing it."""
    say("timing the checks")
    sensor = sensor_preset("comet-pro-ae")
    camera = sensor.camera
    rig = Rig((1920, 1200))
    sequence = PatternSequence(
        name="two fringes",
        projector_width=1920,
        projector_height=1200,
        columns=_columns((1, 16)),
    )
    small = [rig.frame(fringe(p, 90 * k, size=1920)) for p in (1, 16) for k in range(4)]
    size = (camera.width, camera.height)
    noise = np.random.default_rng(7).normal(0, 1, size[::-1])
    frames = np.array(
        [np.clip(np.rint(cv2.resize(frame, size) + noise), 0, 255) for frame in small], np.uint8
    )
    stack = FrameStack(frames=frames)
    limits = DecodingLimits()
    plate = flat_plate(sensor, 10.0, -5.0)
    part = many_holes(40)
    capture = plate_capture(sensor, plate)
    views = view_features(part, sensor, plate.camera_from_part)
    search = point_search(plate.cloud, camera)
    rows = observe_capture(capture, views, search)

    decoded = decode(stack, sequence, limits, checked=False)

    def observe() -> None:
        views = view_features(part, sensor, plate.camera_from_part)
        observe_capture(capture, views, point_search(plate.cloud, camera))

    def check() -> None:
        list(frame_contradictions(stack, sequence, limits))
        map_contradiction(decoded, camera, projector, projector_from_camera)
        list(capture_contradictions(capture, sensor, views, rows, search))

    projector = rig.projector
    projector_from_camera = rig.projector_from_camera

    def to_cloud() -> None:
        triangulate(
            decode(stack, sequence, limits, checked=False),
            camera=camera,
            projector=projector,
            projector_from_camera=projector_from_camera,
        )

    decoding = best_of(7, to_cloud)
    observing, checking = best_of(7, observe), best_of(7, check)
    whole = decoding.wall_s + observing.wall_s
    return [
        Figure(name="decode_and_observe_ms", value=1000 * whole, unit="ms"),
        Figure(name="checks_ms", value=1000 * checking.wall_s, unit="ms"),
        at_most("check_overhead", checking.wall_s / whole, 0.10),
        Figure(
            name="check_overhead_cpu",
            value=checking.cpu_s / (decoding.cpu_s + observing.cpu_s),
        ),
    ]


def _columns(periods: Sequence[float]) -> AxisCoding:
    return AxisCoding(
        fringes=tuple(
            Fringe(periods=p, frames=tuple(range(4 * i, 4 * i + 4))) for i, p in enumerate(periods)
        )
    )


# -- codings -------------------------------------------------------------------------------------


def codings() -> list[Figure]:
    """Measure the depth errors of heterodyne fringes, and of codes that two cameras decode."""
    say("depth from heterodyne fringes and from two cameras' codes")
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            rig = heterodyne_rig((64, 63, 56))
            sequence = read_sequence("s.toml")
            decoded = decode(read_recording("frames", sequence), sequence)
        finally:
            os.chdir(before)
    cloud = triangulate(
        decoded,
        camera=rig.camera,
        projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
    )
    heterodyne_mm = _errors_mm(cloud.points, rig)
    stereo_mm = _stereo_errors_mm()
    return [
        at_most("heterodyne_median_mm", float(np.median(heterodyne_mm)), 0.15, "mm"),
        Figure(name="heterodyne_over_2_mm", value=float(np.mean(heterodyne_mm > 2))),
        at_most("stereo_codes_median_mm", float(np.median(stereo_mm)), 0.15, "mm"),
        Figure(name="stereo_codes_over_2_mm", value=float(np.mean(stereo_mm > 2))),
        Figure(name="stereo_codes_points_share", value=stereo_mm.size / rig.depth_mm.size),
    ]


def _errors_mm(points: NDArray[np.float32], rig: Rig) -> NDArray[np.float64]:
    off = np.abs(points[..., 2].astype(float) - rig.depth_mm)
    return np.asarray(off[np.isfinite(off)])


def _stereo_errors_mm() -> NDArray[np.float64]:
    """Return errors of depth of the rig's camera and a second one, without the projector's pose."""
    first_from_second = RigidTransform.from_fanuc_wpr([90.0, 1.0, 4.0], 0.5, -9.0, 0.3)
    first = Rig()
    second = Rig(seed=2, usual_from_camera=first_from_second)
    sequence = PatternSequence(
        name="three fringes",
        projector_width=1024,
        projector_height=768,
        columns=_columns((1, 8, 64)),
    )

    def decoded(rig: Rig) -> DecodedMap:
        frames = [rig.frame(fringe(p, 90 * k)) for p in (1, 8, 64) for k in range(4)]
        return decode(FrameStack(frames=np.array(frames, np.uint8)), sequence)

    cloud = match_codes(
        decoded(first),
        decoded(second),
        rectify(first.camera, second.camera, first_from_second),
        depth_limits_mm=(300.0, 800.0),
    )
    return _errors_mm(cloud.points, first)


def noise() -> list[Figure]:
    """Compare the predicted standard deviation of depth with repeats of the simulated cell."""
    say("standard deviation of depth: 30 repeats")
    ratio = sigma_z_ratio(30)
    return [
        Figure(name="sigma_z_ratio", value=ratio, mark="0.9–1.1", met=bool(0.9 <= ratio <= 1.1))
    ]


if __name__ == "__main__":
    publish(
        "Wrong input is caught by what contradicts it",
        [*tried(CASES), *codings(), *noise(), *overhead(), *false_alarms()],
    )
