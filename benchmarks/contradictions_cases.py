"""What people bring, made anew: each case writes its files, and says what is right.

An attempt is a call of the command line. It must give the right answer (`right`), or end in an
error or a contradiction whose words name what is wrong (`names`), or either. The rig and the plate
have known depths, p_norm 1 and known brightness.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shlex
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.measuring import Figure, at_most, say
from benchmarks.rig import Rig, bit, fringe, lit, save, unlit
from exposight.cell import Cloud, read_cloud, write_cloud
from exposight.cli import main
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.observing import read_observations

_WRONG_MM = 2.0
_WRONG_SHARE = 0.002
"""Pixels that the step's edge cuts see wall and box: so many may be anywhere between."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """A call, and what must come of it.

    Parameters
    ----------
    call : str
        Words of the command line, quoted as for a shell.
    names : str
        Regular expression that an error or contradiction must match; empty where there must be
        none.
    right : callable, optional
        Tells whether what was written is right; None where the call must fail.
    """

    call: str
    names: str = ""
    right: Callable[[], bool] | None = None


Case = Callable[[], list[Attempt]]
"""Writes its files to the current folder."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What came of an attempt."""

    case: str
    call: str
    outcome: str
    said: str

    @property
    def is_silent(self) -> bool:
        """True where a wrong number left without a word."""
        return self.outcome == "SILENT"

    @property
    def is_right_or_named(self) -> bool:
        """True where the answer is right, or what is wrong was named."""
        return self.outcome in {"right", "named"}


def try_cases(cases: Mapping[str, Case]) -> Iterator[Verdict]:
    """Try every attempt of every case, each case in a folder of its own."""
    before = Path.cwd()
    for name, case in cases.items():
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                for attempt in case():
                    yield _try(name, attempt)
            finally:
                os.chdir(before)


def tried(cases: Mapping[str, Case]) -> list[Figure]:
    """Try cases, print what came of each, and count."""
    say("trying the cases that users bring")
    verdicts = list(try_cases(cases))
    table = Table("case", "call", "outcome", "said", title="cases")
    for verdict in verdicts:
        said = "" if verdict.outcome == "right" else verdict.said[:300]
        table.add_row(verdict.case, verdict.call[:80], verdict.outcome, said)
    Console(width=180).print(table)
    fine = sum(verdict.is_right_or_named for verdict in verdicts)
    return [
        Figure(name="kinds_of_cases", value=len(cases)),
        Figure(name="cases", value=len(verdicts)),
        Figure(
            name="cases_right_or_named",
            value=fine,
            mark=f"= {len(verdicts)}",
            met=fine == len(verdicts),
        ),
        at_most("cases_silently_wrong", sum(verdict.is_silent for verdict in verdicts), 0),
    ]


def _try(case: str, attempt: Attempt) -> Verdict:
    out, err = io.StringIO(), io.StringIO()
    for left in ("cloud.ply", "observations.csv"):
        Path(left).unlink(missing_ok=True)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main([*shlex.split(attempt.call), "--json"])
    document = json.loads(out.getvalue())
    if status:
        said = str(document["error"]["message"] if "error" in document else document)
        named = bool(attempt.names) and re.search(attempt.names, said) is not None
        outcome = "named" if named else "refused without its cause"
    else:
        said = json.dumps([document["contradictions"], document["notes"]], ensure_ascii=False)
        is_right = attempt.right is not None and attempt.right()
        named = bool(attempt.names) and re.search(attempt.names, said) is not None
        outcome = "right" if is_right else "named" if named else "SILENT"
    return Verdict(case=case, call=attempt.call, outcome=outcome, said=said)


# -- decoding: the rig ---------------------------------------------------------------------------


def depth_errors_mm(rig: Rig, path: str = "cloud.ply") -> NDArray[np.float64]:
    """Return |z − truth| of a cloud's points."""
    off = np.abs(np.asarray(read_cloud(Path(path)).points[..., 2], dtype=float) - rig.depth_mm)
    return np.asarray(off[np.isfinite(off)])


def _is_right(
    rig: Rig, *, median_mm: float = 0.4, wrong_mm: float = _WRONG_MM, least_share: float = 0.5
) -> Callable[[], bool]:
    def right() -> bool:
        if not Path("cloud.ply").is_file():
            return False
        off = depth_errors_mm(rig)
        return bool(
            off.size >= least_share * rig.depth_mm.size
            and np.median(off) <= median_mm
            and np.mean(off > wrong_mm) <= _WRONG_SHARE
        )

    return right


_DECODE = "decode {frames} -c calibration.yml -s {sequence} -o cloud.ply"


def _decode(
    sequence: str, names: str = "", rig: Rig | None = None, frames: str = "frames"
) -> Attempt:
    call = _DECODE.format(frames=frames, sequence=sequence)
    return Attempt(call=call, names=names, right=None if rig is None else _is_right(rig))


def _sequence(path: str, rig: Rig, tables: str, top: str = "") -> None:
    Path(path).write_text(
        f'name = "tried"\nprojector_width = {rig.projector.width}\n'
        f"projector_height = {rig.projector.height}\n{top}\n{tables}"
    )


def _fringes(sets: Sequence[tuple[float, Sequence[int]]], axis: str = "columns") -> str:
    return "".join(
        f"\n[[{axis}.fringes]]\nperiods = {periods}\nframes = {list(frames)}\n"
        for periods, frames in sets
    )


def heterodyne_rig(periods: Sequence[float], steps: int = 4, *, seed: int = 1) -> Rig:
    """Write frames and sequence of fringe sets without a Gray code, and return their rig."""
    rig = Rig(seed=seed)
    frames = [rig.frame(fringe(p, 360 * k / steps)) for p in periods for k in range(steps)]
    save(Path("frames"), frames)
    rig.calibration(Path("calibration.yml"))
    sets = [(p, range(i * steps, (i + 1) * steps)) for i, p in enumerate(periods)]
    _sequence("s.toml", rig, _fringes(sets))
    return rig


def heterodyne() -> list[Attempt]:
    """01: fringe sets whose beats make them absolute, and one whose beats do not."""
    attempts = []
    for number, periods in enumerate(((64, 63, 56), (56, 63, 64), (70, 64, 59), (36, 35, 30))):
        rig = heterodyne_rig(periods)
        for old, new in (("frames", f"frames{number}"), ("s.toml", f"s{number}.toml")):
            Path(old).rename(new)
        attempts.append(_decode(f"s{number}.toml", rig=rig, frames=f"frames{number}"))
    heterodyne_rig((64, 56, 48))
    attempts.append(_decode("s.toml", names="128|8 times|ambiguous|repeat"))
    return attempts


def complementary_code() -> list[Attempt]:
    """02: Gray code of the fringe's width with a complementary bit, stripes out of focus."""
    rig = Rig()
    rig.noise, wide = 2.0, 32.0

    def soft(
        pattern: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    ) -> Callable[..., NDArray[np.float64]]:
        shifts = np.linspace(-2.5, 2.5, 11)
        return lambda u: np.mean([pattern(u + shift) for shift in shifts], axis=0)

    frames = [rig.frame(fringe(32, 90 * k)) for k in range(4)]
    frames += [rig.frame(soft(bit(i, 5, width=wide))) for i in range(5)]
    frames += [rig.frame(soft(bit(5, 6, width=wide / 2))), rig.frame(lit), rig.frame(unlit)]
    save(Path("frames"), frames)
    rig.calibration(Path("calibration.yml"))
    top = "white_frame = 10\nblack_frame = 11\n"
    phase = _fringes([(32, range(4))])
    five = f"[columns.gray_code]\nframes = [4,5,6,7,8]\ncode_width = 32\n{phase}"
    six = f"[columns.gray_code]\nframes = [4,5,6,7,8,9]\ncode_width = 16\n{phase}"
    extra = five.replace("code_width = 32", "code_width = 32\ncomplementary_frame = 9")
    _sequence("five.toml", rig, five, top + "unused_frames = [9]\n")
    _sequence("six.toml", rig, six, top)
    _sequence("complementary.toml", rig, extra, top)
    return [_decode(f"{name}.toml", rig=rig) for name in ("five", "six", "complementary")]


def reversed_steps() -> list[Attempt]:
    """03: steps that run the other way than the sequence says."""
    attempts = []
    for steps in (4, 3, 5):
        rig = Rig(seed=steps)
        frames = [rig.frame(fringe(32, -360 * k / steps)) for k in range(steps)]
        frames += [rig.frame(bit(i, 5, width=32.0)) for i in range(5)]
        frames += [rig.frame(lit), rig.frame(unlit)]
        save(Path(f"frames{steps}"), frames)
        rig.calibration(Path("calibration.yml"))
        top = f"white_frame = {steps + 5}\nblack_frame = {steps + 6}\n"
        code = f"[columns.gray_code]\nframes = {list(range(steps, steps + 5))}\ncode_width = 32\n"
        tables = code + _fringes([(32, range(steps))])
        shifts = [-360 * k / steps for k in range(steps)]
        _sequence(f"as-usual{steps}.toml", rig, tables, top)
        _sequence(f"as-is{steps}.toml", rig, f"{tables}shifts_deg = {shifts}\n", top)
        other = "revers|other way|shifts"
        attempts.append(_decode(f"as-usual{steps}.toml", names=other, frames=f"frames{steps}"))
        attempts.append(_decode(f"as-is{steps}.toml", rig=rig, frames=f"frames{steps}"))
    return attempts


def order_of_bits() -> list[Attempt]:
    """04: bits finest first, inverses first, black first, plain binary."""
    rig = Rig()
    white, black = rig.frame(lit), rig.frame(unlit)
    bits = [rig.frame(bit(i, 10)) for i in range(10)]
    inverses = [rig.frame(bit(i, 10, inverse=True)) for i in range(10)]
    binary = [rig.frame(bit(i, 10, binary=True)) for i in range(10)]
    pairs = [frame for pair in zip(inverses, bits, strict=True) for frame in pair]
    for name, frames in (
        ("finest", [white, black, *bits[::-1]]),
        ("inverse", [white, black, *pairs]),
        ("black", [black, white, *bits]),
        ("binary", [white, black, *binary]),
    ):
        save(Path(name), frames)
    rig.calibration(Path("calibration.yml"))
    top = "white_frame = 0\nblack_frame = 1\n"
    coded = f"[columns.gray_code]\nframes = {list(range(2, 12))}\n"
    _sequence("s.toml", rig, coded, top)
    coarse = [rig.frame(bit(i, 5, width=32.0, binary=True)) for i in range(5)]
    steps = [rig.frame(fringe(32, 90 * k)) for k in range(4)]
    save(Path("coarse"), [white, black, *coarse, *steps])
    coded5 = "[columns.gray_code]\nframes = [2, 3, 4, 5, 6]\ncode_width = 32\n"
    phase = _fringes([(32, range(7, 11))])
    _sequence("binary.toml", rig, f'{coded5}code = "binary"\n{phase}', top)
    _sequence("gray.toml", rig, coded5 + phase, top)
    evens, odds = list(range(2, 22, 2)), list(range(3, 22, 2))
    for name, first, second in (("inverse", evens, odds), ("right", odds, evens)):
        tables = f"[columns.gray_code]\nframes = {first}\ninverse_frames = {second}\n"
        _sequence(f"{name}.toml", rig, tables, top)
    return [
        _decode("s.toml", names="finest|order|least significant|last", frames="finest"),
        _decode("inverse.toml", names="inver", frames="inverse"),
        _decode("right.toml", rig=rig, frames="inverse"),
        _decode("s.toml", names="black|white", rig=rig, frames="black"),
        _decode("s.toml", names="binary", frames="binary"),
        _decode("gray.toml", names="binary", frames="coarse"),
        _decode("binary.toml", rig=rig, frames="coarse"),
    ]


def other_bit_depths() -> list[Attempt]:
    """05: 10, 12 and 14 bits in files of 16, a spot that clips, and values in the high bits."""
    attempts = []
    row, column = np.mgrid[0:240, 0:320]
    spot = 1 + 2.2 * np.exp(-((column - 200) ** 2 + (row - 150) ** 2) / 35.0**2)
    for bits in (10, 12, 14):
        full = 2**bits - 1
        rig = Rig(seed=bits)
        rig.white, rig.black, rig.noise = 0.58 * full, 0.04 * full, 0.003 * full
        frames = [
            rig.frame(fringe(p, 90 * k), albedo=spot, full_scale=full)
            for p in (1, 16)
            for k in range(4)
        ]
        clipped = np.max(frames, axis=0) >= full
        save(Path(f"frames{bits}"), frames, np.uint16)
        save(Path(f"high{bits}"), [frame * 2 ** (16 - bits) for frame in frames], np.uint16)
        rig.calibration(Path("calibration.yml"))
        tables = _fringes([(1, range(4)), (16, range(4, 8))])

        def right(rig: Rig = rig, clipped: NDArray[np.bool_] = clipped) -> bool:
            kept = np.isfinite(read_cloud(Path("cloud.ply")).points[..., 2])
            return _is_right(rig)() and not kept[clipped].any()

        for said in (bits, 16, *([12] if bits == 10 else [])):
            _sequence(f"{bits}as{said}.toml", rig, tables, f"bit_depth = {said}\n")
            call = _DECODE.format(frames=f"frames{bits}", sequence=f"{bits}as{said}.toml")
            attempts.append(
                Attempt(call=call, right=right)
                if said == bits
                else Attempt(call=call, names=f"{bits} bits|bit depth of {bits}|{full}")
            )
        _sequence(f"high{bits}.toml", rig, tables, f'bit_depth = {bits}\nalignment = "high"\n')
        _sequence(f"low{bits}.toml", rig, tables, "bit_depth = 16\n")
        call = _DECODE.format(frames=f"high{bits}", sequence=f"high{bits}.toml")
        attempts.append(Attempt(call=call, right=right))
        attempts.append(
            _decode(f"low{bits}.toml", frames=f"high{bits}", names=f"{bits} bits|depth of {bits}")
        )
    return attempts


def colours() -> list[Attempt]:
    """07: a mosaic saved as grey, colour images, and grey ones with three channels."""
    rig = Rig()
    row, column = np.mgrid[0:240, 0:320]
    patterns = [fringe(p, 90 * k) for p in (1, 16) for k in range(4)]
    attempts = []
    _sequence("s.toml", rig, _fringes([(1, range(4)), (16, range(4, 8))]))
    rig.calibration(Path("calibration.yml"))
    for name, (red, blue) in {"rggb": ((0, 0), (1, 1)), "grbg": ((0, 1), (1, 0))}.items():
        site = (row % 2, column % 2)
        is_red = (site[0] == red[0]) & (site[1] == red[1])
        is_blue = (site[0] == blue[0]) & (site[1] == blue[1])
        response = np.where(is_red, 1.0, np.where(is_blue, 0.10, 0.45))
        save(Path(name), [rig.frame(p, albedo=response) for p in patterns])
        attempts.append(_decode("s.toml", names="mosaic|Bayer", frames=name))
    grey = [rig.frame(p, albedo=0.5) for p in patterns]
    save(Path("rgb"), [np.dstack([f * 0.3, f, np.clip(f * 2, 0, 255)]) for f in grey])
    save(Path("grey3"), [np.dstack([f] * 3) for f in grey])
    _sequence(
        "green.toml", rig, _fringes([(1, range(4)), (16, range(4, 8))]), 'channel = "green"\n'
    )
    return [
        *attempts,
        _decode("s.toml", names="channel", frames="rgb"),
        _decode("green.toml", rig=rig, frames="rgb"),
        _decode("s.toml", rig=rig, frames="grey3"),
    ]


def centred_codes() -> list[Attempt]:
    """08: a code that its generator centres on the projector's columns."""
    attempts = []
    for width, height in ((1920, 1080), (1280, 800)):
        rig = Rig((width, height))
        first = (2048 - width) // 2
        frames = [rig.frame(lit), rig.frame(unlit)]
        for i in range(11):
            for inverse in (False, True):
                pattern = bit(i, 11, size=width, first=first, inverse=inverse)
                frames.append(rig.frame(pattern))
        save(Path(f"frames{width}"), frames)
        rig.calibration(Path(f"calibration{width}.yml"))
        tables = (
            f"[columns.gray_code]\nframes = {list(range(2, 24, 2))}\n"
            f"inverse_frames = {list(range(3, 24, 2))}\n"
        )
        top = "white_frame = 0\nblack_frame = 1\n"
        _sequence(f"plain{width}.toml", rig, tables, top)
        _sequence(f"first{width}.toml", rig, f"{tables}first_code = {first}\n", top)
        call = f"decode frames{width} -c calibration{width}.yml -o cloud.ply -s "
        attempts.append(
            Attempt(call=f"{call}plain{width}.toml", names=f"first_code|offset|{first}")
        )
        # A camera pixel sees up to five columns, so the finest bits are grey: ± 1 mm and more.
        right = _is_right(rig, median_mm=1.5, wrong_mm=4.0)
        attempts.append(Attempt(call=f"{call}first{width}.toml", right=right))
    return attempts


def metres() -> list[Attempt]:
    """09: a calibration whose translation is in metres."""
    rig = Rig()
    frames = [rig.frame(lit), rig.frame(unlit), *(rig.frame(bit(i, 10)) for i in range(10))]
    save(Path("frames"), frames)
    rig.calibration(Path("calibration.yml"), translation_scale=1e-3)
    _sequence(
        "s.toml",
        rig,
        f"[columns.gray_code]\nframes = {list(range(2, 12))}\n",
        "white_frame = 0\nblack_frame = 1\n",
    )
    rest = "--name x --exposures 1 100 --working-distance 400 600 -o sensor.json"
    return [
        _decode("s.toml", names="in m\\?"),
        Attempt(call=_decode("s.toml").call + " --depth-limits 300 800", names="in m\\?"),
        Attempt(call=f"sensor calibration.yml {rest}", names="in m\\?"),
    ]


def gamma() -> list[Attempt]:
    """26: a projector of gamma 2.2, three steps and four."""
    rig = Rig()
    rig.calibration(Path("calibration.yml"))
    attempts = []
    for steps in (4, 3):
        for name, exponent in (("linear", 1.0), ("gamma", 2.2)):
            frames = [
                rig.frame(fringe(p, 360 * k / steps, gamma=exponent))
                for p in (1, 16)
                for k in range(steps)
            ]
            save(Path(f"{name}{steps}"), frames)
        tables = _fringes([(1, range(steps)), (16, range(steps, 2 * steps))])
        _sequence(f"s{steps}.toml", rig, tables)
        _sequence(
            f"known{steps}.toml", rig, tables, "projector_gamma = 2.2\npattern_contrast = 0.9\n"
        )
        right = rig if steps == 4 else None
        attempts += [
            _decode(f"s{steps}.toml", rig=rig, frames=f"linear{steps}"),
            _decode(f"s{steps}.toml", names="gamma", rig=right, frames=f"gamma{steps}"),
            _decode(f"known{steps}.toml", rig=rig, frames=f"gamma{steps}"),
        ]
    return attempts


# -- observing: a plate with four holes ----------------------------------------------------------

HOLES = {
    "h1": (-60.0, -40.0, 6.0),
    "h2": (50.0, -45.0, 8.0),
    "h3": (-55.0, 45.0, 5.0),
    "h4": (62.0, 38.0, 10.0),
}
PLATE = RigidTransform.from_fanuc_wpr([4.0, -3.0, 500.0], 180.0, 8.0, 0.0)
_USUAL = PinholeCamera(width=640, height=480, fx=800.0, fy=800.0, cx=319.5, cy=239.5)


@dataclass(frozen=True, kw_only=True)
class Plate:
    """A plate before a camera: what an image and a perfect cloud of it are."""

    camera: PinholeCamera = _USUAL
    points: NDArray[np.float32] = field(init=False)
    image: NDArray[np.uint8] = field(init=False)

    def __post_init__(self) -> None:
        rays = np.dstack([self.camera.rays(), np.ones((self.camera.height, self.camera.width))])
        normal = PLATE.z_axis
        points = rays * ((normal @ PLATE.translation_mm) / (rays @ normal))[..., None]
        on_plate = PLATE.inverse().apply(points)
        x, y = on_plate[..., 0], on_plate[..., 1]
        missing = (np.abs(x) > 110) | (np.abs(y) > 85)
        for left, up, radius in HOLES.values():
            missing |= (x - left) ** 2 + (y - up) ** 2 < radius**2
        grey = np.where(np.floor(x / 4) % 2 < 1, 150.0, 40.0) * (1 + x / 1000)
        grey = np.where(missing, 4.0, grey) + np.random.default_rng(0).normal(0, 1, x.shape)
        points[missing] = np.nan
        object.__setattr__(self, "points", points.astype(np.float32))
        object.__setattr__(self, "image", np.clip(np.rint(grey), 0, 255).astype(np.uint8))

    def write(self) -> None:
        """Write image, features, pose, and the camera as ROS does."""
        cv2.imwrite("image.png", self.image)
        rows = [f"{n},hole,{x},{y},0,0,0,1,{r}" for n, (x, y, r) in HOLES.items()]
        header = "name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm"
        Path("features.csv").write_text("\n".join([header, *rows, ""]))
        np.savetxt("pose.txt", PLATE.to_matrix())
        write_cloud(Path("full.npy"), Cloud(points=self.points))
        camera_info("camera.yaml", self.camera)
        quietly(f"sensor camera.yaml --raw {_SENSOR}")

    def is_right(self) -> bool:
        """Tell whether the observations are those of this plate."""
        frame = read_observations("observations.csv").frame
        p_norm, i_avg = frame["p_norm"].to_numpy(), frame["i_avg"].to_numpy()
        return bool(np.abs(p_norm - 1).max() <= 0.05 and np.abs(i_avg - 95).max() <= 20)


_SENSOR = "--name cam --exposures 0.1 100 --working-distance 300 700 -o sensor.json"


def camera_info(
    path: str, camera: PinholeCamera, p: PinholeCamera | None = None, shift: float = 0.0
) -> None:
    """Write a ROS camera_info: K and D of a camera, P of the rectified one, P[3] = `shift`."""
    p = p or camera
    distortion = list(camera.distortion) or [0.0] * 5
    Path(path).write_text(
        f"image_width: {camera.width}\nimage_height: {camera.height}\ncamera_name: cam\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: [{camera.fx}, 0., {camera.cx}, 0., {camera.fy}, {camera.cy}, 0., 0., 1.]\n"
        "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
        f"  data: {distortion}\nrectification_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]\n"
        "projection_matrix:\n  rows: 3\n  cols: 4\n"
        f"  data: [{p.fx}, 0., {p.cx}, {shift}, 0., {p.fy}, {p.cy}, 0., 0., 0., 1., 0.]\n"
    )


def quietly(call: str) -> None:
    """Call a command whose words are separated by blanks, without its output."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        main(call.split())


def observe_attempt(options: str, names: str = "", plate: Plate | None = None) -> Attempt:
    """Return the attempt to observe the plate with other options than the usual ones."""
    call = f"observe --sensor sensor.json -o observations.csv {options}"
    for option, usual in (
        ("--image", "image.png"),
        ("--exposure-ms", "10"),
        ("--features", "features.csv"),
        ("--cloud", "full.npy"),
        ("--pose", "pose.txt"),
    ):
        given = re.search(rf"{option}\b(?!-)", options)
        if not given and not (option == "--pose" and re.search("--robot-pose|--flange", options)):
            call += f" {option} {usual}"
    return Attempt(call=call, names=names, right=None if plate is None else plate.is_right)


def turned_clouds() -> list[Attempt]:
    """14: clouds as viewers want them, in metres, valid points alone and organised."""
    plate = Plate()
    plate.write()
    attempts = []
    for name, turn in (("gl", (1, -1, -1)), ("flipped", (-1, -1, 1)), ("back", (1, 1, -1))):
        turned = plate.points * np.array(turn, dtype=np.float32)
        axes = " ".join(f"{'-' if t < 0 else ''}{a}" for t, a in zip(turn, "xyz", strict=True))
        write_cloud(Path(f"{name}.npy"), Cloud(points=turned))
        loose = turned[np.isfinite(turned[..., 0])]
        write_cloud(Path(f"{name}.ply"), Cloud(points=loose))
        write_cloud(Path(f"{name}-m.ply"), Cloud(points=loose / 1000))
        attempts += [
            observe_attempt(f"--cloud {name}.npy", names="axes are turned|run the other way"),
            observe_attempt(f"--cloud {name}.npy --cloud-axes {axes}", plate=plate),
        ]
        if turn[2] < 0:
            attempts += [
                observe_attempt(f"--cloud {name}.ply", names="axes are turned"),
                observe_attempt(f"--cloud {name}-m.ply", names="in m and its axes|axes are turned"),
                observe_attempt(f"--cloud {name}-m.ply --cloud-unit m", names="axes are turned"),
            ]
        attempts.append(
            observe_attempt(f"--cloud {name}-m.ply --cloud-unit m --cloud-axes {axes}", plate=plate)
        )
    return attempts


def depth_images() -> list[Attempt]:
    """16: depth images, and the same with a wrong scale."""
    plate = Plate()
    plate.write()
    depth = np.nan_to_num(plate.points[..., 2])
    cv2.imwrite("depth.png", np.rint(depth * 10).astype(np.uint16))
    cv2.imwrite("metres.tiff", (depth / 1000).astype(np.float32))
    np.save("depth.npy", depth)
    cv2.imwrite("half.png", np.rint(depth[::2, ::2] * 10).astype(np.uint16))
    return [
        observe_attempt("--cloud depth.png", names="scale"),
        observe_attempt("--cloud depth.png --depth-scale 0.1", plate=plate),
        observe_attempt("--cloud depth.png --depth-scale 1", names="scale|working distance"),
        observe_attempt("--cloud metres.tiff --depth-scale 1000", plate=plate),
        observe_attempt("--cloud half.png --depth-scale 0.1", plate=plate),
    ]


def coarser_clouds() -> list[Attempt]:
    """17: clouds at a fraction of the image's resolution."""
    plate = Plate()
    plate.write()
    attempts = [observe_attempt("--cloud full.npy", plate=plate)]
    for step in (2, 4):
        coarse = plate.points[::step, ::step]
        write_cloud(Path(f"every{step}.ply"), Cloud(points=coarse))
        write_cloud(Path(f"loose{step}.ply"), Cloud(points=coarse[np.isfinite(coarse[..., 0])]))
        attempts += [
            observe_attempt(f"--cloud every{step}.ply", plate=plate),
            observe_attempt(f"--cloud loose{step}.ply", names="points on every", plate=plate),
        ]
    return attempts


def rectified_images() -> list[Attempt]:
    """18: images and clouds are rectified, the calibration's K and D are of the raw ones."""
    rectified = PinholeCamera(width=640, height=480, fx=905.0, fy=905.0, cx=344.0, cy=226.0)
    raw = PinholeCamera(
        width=640, height=480, fx=800.0, fy=800.0, cx=319.5, cy=239.5,
        distortion=(-0.28, 0.11, 0.0005, -0.0003, 0.0),
    )  # fmt: skip
    plate = Plate(camera=rectified)
    plate.write()
    camera_info("info.yaml", raw, rectified)
    for kind in ("raw", "rectified"):
        quietly(f"sensor info.yaml --{kind} {_SENSOR.replace('sensor.json', kind + '.json')}")
    kept = observe_attempt("--cloud full.npy", plate=plate)
    return [
        Attempt(call=f"sensor info.yaml {_SENSOR}", names="raw.*rectified"),
        Attempt(call=kept.call.replace("sensor.json", "raw.json"), names="rectified.*905"),
        Attempt(call=kept.call.replace("sensor.json", "rectified.json"), right=plate.is_right),
        kept,
    ]


def stereo_pairs() -> list[Attempt]:
    """24: left and right image of an active stereo camera."""
    plate, base_mm = Plate(), 60.0
    plate.write()
    rng = np.random.default_rng(5)
    z = np.where(np.isfinite(plate.points[..., 2]), plate.points[..., 2], 520.0)
    random = np.where(rng.random((480, 640)) < 0.12, 200.0, 60.0)
    dots = cv2.GaussianBlur(random, (3, 3), 0.8)
    row, column = np.mgrid[0:480, 0:640].astype(np.float32)
    shift = (_USUAL.fx * base_mm / z).astype(np.float32)
    left = cv2.remap(dots, column - shift, row, cv2.INTER_LINEAR)
    for name, image in (("left", left), ("right", dots)):
        cv2.imwrite(f"{name}.png", np.clip(image, 0, 255).astype(np.uint8))
    camera_info("left.yaml", _USUAL)
    camera_info("right.yaml", _USUAL, shift=-_USUAL.fx * base_mm / 1000)
    camera_info("wrong.yaml", _USUAL, shift=-_USUAL.fx * base_mm)
    rest = "--name s --exposures 0.1 20 --working-distance 300 900"
    quietly(f"sensor left.yaml right.yaml {rest} -o stereo.json")

    def right() -> bool:
        points = read_cloud(Path("cloud.ply")).points
        off = np.abs(points[..., 2] - plate.points[..., 2])
        off = off[np.isfinite(off)]
        return bool(off.size > 50_000 and np.median(off) < 0.5 and np.mean(off > 5) < 0.01)

    return [
        Attempt(
            call="decode --stereo left.png right.png --sensor stereo.json -o cloud.ply", right=right
        ),
        Attempt(
            call="decode --stereo right.png left.png --sensor stereo.json -o cloud.ply",
            names="swap|left and right|the other way|right of",
        ),
        Attempt(call=f"sensor left.yaml wrong.yaml {rest} -o w.json", names=" m[ ?.;,)]|metres"),
    ]


def exposures_and_depths() -> list[Attempt]:
    """25: an exposure time in other units, an image of 10 bits said to be others."""
    plate = Plate()
    plate.write()
    levels = np.clip(np.rint(plate.image.astype(float) * 1023 / 255), 0, 1023).astype(np.uint16)
    cv2.imwrite("image10.png", levels)
    cloud = "--cloud full.npy"
    return [
        observe_attempt(cloud, plate=plate),
        *(
            observe_attempt(f"{cloud} --exposure-ms {wrong}", names="ms")
            for wrong in ("10000", "0.01", "0")
        ),
        observe_attempt(f"{cloud} --image image10.png --bit-depth 10", plate=plate),
        *(
            observe_attempt(
                f"{cloud} --image image10.png --bit-depth {wrong}", names="10|bit depth"
            )
            for wrong in (8, 12, 16)
        ),
    ]


CASES: dict[str, Case] = {
    "01 heterodyne": heterodyne,
    "02 complementary code": complementary_code,
    "03 reversed steps": reversed_steps,
    "04 order of bits": order_of_bits,
    "05 bit depths": other_bit_depths,
    "07 colours": colours,
    "08 centred codes": centred_codes,
    "09 metres": metres,
    "14 turned clouds": turned_clouds,
    "16 depth images": depth_images,
    "17 coarser clouds": coarser_clouds,
    "18 rectified images": rectified_images,
    "24 stereo pairs": stereo_pairs,
    "25 exposures and depths": exposures_and_depths,
    "26 gamma": gamma,
}
