"""Files that two readings fit equally well, each of which must be asked for: `AMBIGUOUS`."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from exposight.cell import read_cloud, read_features
from exposight.cli import main
from exposight.errors import AmbiguousError
from exposight.geometry import read_pose
from exposight.observing import read_observations

_QUATERNION = "0.1,0.7,0.1,0.7"
_TIMES = (0.5, 0.7, 0.9, 1.2)


@dataclass(frozen=True, kw_only=True)
class Ambiguous:
    """A file that must be asked about.

    Parameters
    ----------
    question : str
        What it does not tell.
    name : str
        The file's name.
    content : str or callable
        Its text, or what writes it.
    read : callable
        Reads it; must raise `AmbiguousError`.
    """

    question: str
    name: str
    content: str | Callable[[Path], object]
    read: Callable[[Path], object]

    def outcome(self, folder: Path) -> str:
        """Write and read it; return an empty text where it was asked about."""
        path = folder / self.name
        try:
            if isinstance(self.content, str):
                path.write_text(self.content)
            else:
                self.content(path)
            got = self.read(path)
        except AmbiguousError as error:
            return "" if len(error.readings) > 1 else f"asked without answers: {error}"
        except Exception as error:  # whatever comes is the finding
            return f"{type(error).__name__}: {error}"
        return f"read as {got!r}"[:200]


def _command(*words: str) -> Callable[[Path], object]:
    """Return what calls the command line, where {} is the file, and raises what it reports."""

    def call(path: Path) -> object:
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
            status = main([*(word.replace("{}", str(path)) for word in words), "--json"])
        document = json.loads(said.getvalue())
        if status and document["error"]["type"] == "AmbiguousError":
            raise AmbiguousError(document["error"]["message"], ("asked", "asked"))
        if status:
            raise ValueError(document["error"]["message"])
        return "a result"

    return call


def _commas(rows: NDArray[np.float64]) -> str:
    """Return numbers with decimal commas, commas between: nobody can tell which is which."""
    return "\n".join(",".join(f"{x:.1f}".replace(".", ",") for x in row) for row in rows) + "\n"


def _clouds() -> list[Ambiguous]:
    rng = np.random.default_rng(2)
    points = rng.uniform(11, 99, (30, 3))
    whole = rng.integers(1, 9, (30, 3))
    thousands = "\n".join(
        ";".join(f"{a},{b:03d}" for a, b in zip(row, rng.integers(100, 999, 3), strict=True))
        for row in whole
    )
    kinds = {
        "commas.xyz": _commas(points),
        "commas.txt": _commas(points - 120),
        "commas.asc": "# a scan\n" + _commas(points),
        "commas.pts": _commas(points * 2),
        "thousands.xyz": thousands + "\n",
        "thousands.csv": "X [mm];Y [mm];Z [mm]\n" + thousands + "\n",
        "thousands.txt": thousands.replace(";", "\t") + "\n",
        "thousands.asc": thousands.replace(";", " ") + "\n",
    }
    return [
        Ambiguous(question="decimal", name=name, content=text, read=read_cloud)
        for name, text in kinds.items()
    ]


def _features() -> list[Ambiguous]:
    rows = [("H1", 12.5, -3.5, 6.0), ("H2", 80.25, 14.0, 8.0), ("H3", -31.0, 22.5, 5.0)]

    def listed(size: str, separator: str = ",", decimal: str = ".", kind: str = "hole") -> str:
        lines = [separator.join(["name", "kind", "x_mm", "y_mm", "z_mm", "nx", "ny", "nz", size])]
        for name, x, y, r in rows:
            cells = [name, kind, *(f"{n:g}".replace(".", decimal) for n in (x, y, 0, 0, 0, 1, r))]
            lines.append(separator.join(cells))
        return "\n".join(lines) + "\n"

    sizes = {
        "size.csv": listed("size_mm"),
        "size-excel.csv": listed("Size [mm]", ";", ","),
        "groesse.csv": listed("Größe [mm]", ";", ","),
        "circle.csv": listed("Size", kind="circle"),
        "hole-size.csv": listed("Hole size (mm)", "\t"),
        "nominal.csv": listed("Nominal", ";"),
    }
    thousands = (
        "name;kind;x_mm;y_mm;z_mm;nx;ny;nz;radius_mm\n"
        "H1;hole;1,250;2,125;3,500;0;0;1;6,125\nH2;hole;4,750;5,250;1,125;0;0;1;8,500\n"
    )
    return [
        *(
            Ambiguous(question="size", name=name, content=text, read=read_features)
            for name, text in sizes.items()
        ),
        Ambiguous(question="decimal", name="thousands.csv", content=thousands, read=read_features),
        Ambiguous(
            question="decimal",
            name="thousands-tabs.txt",
            content=thousands.replace(";", "\t"),
            read=read_features,
        ),
    ]


def _tables() -> list[Ambiguous]:
    header = "feature;view;exposure_ms;p_norm;i_avg;x_mm;y_mm;z_mm;w_deg;p_deg;r_deg;radius_mm"
    row = "h{i};v1;{t};1;90;1,{i}25;2,{i}50;3,{i}75;4;5;0;6"
    thousands = "\n".join([header, *(row.format(i=i, t=5 + i) for i in range(1, 9))])
    unnamed = header.replace("exposure_ms", "exposure").replace(";", ",") + "\n" + "".join(
        f"h{i},v{k},{t},0.9,90,{i}.5,{i}.25,3.5,4,5,0,6\n"
        for k in range(3)
        for i, t in enumerate(_TIMES)
    )  # fmt: skip
    return [
        Ambiguous(question="decimal", name="thousands.csv", content=thousands + "\n",
                  read=read_observations),
        Ambiguous(question="decimal", name="thousands-tabs.csv",
                  content=thousands.replace(";", "\t") + "\n", read=read_observations),
        Ambiguous(question="exposure", name="exposure.csv", content=unnamed,
                  read=read_observations),
        Ambiguous(question="exposure", name="exposure-time.csv",
                  content=unnamed.replace("exposure", "exposure time"), read=read_observations),
    ]  # fmt: skip


def _poses() -> list[Ambiguous]:
    seven = f"12.5,-3.25,500.5,{_QUATERNION}"
    six = "12.5,-3.25,500.5,171.5,8.25,-12.5"
    texts = {
        "seven.txt": seven,
        "seven-blanks.txt": seven.replace(",", " "),
        "seven-lines.txt": seven.replace(",", "\n"),
        "seven-brackets.txt": f"[{seven}]",
        "seven-parts.txt": f"[12.5,-3.25,500.5] [{_QUATERNION}]",
        "seven.json": f"[{seven}]",
        "six.txt": six,
        "six-blanks.txt": six.replace(",", " "),
        "six-brackets.txt": f"[{six}]",
        "six.json": f"[{six}]",
        "six-lines.txt": six.replace(",", "\n"),
    }
    return [
        Ambiguous(
            question="quaternion" if name.startswith("seven") else "notation",
            name=name,
            content=text + "\n",
            read=read_pose,
        )
        for name, text in texts.items()
    ]


def _meshes() -> list[Ambiguous]:
    def write(path: Path) -> None:
        plate = trimesh.creation.annulus(r_min=4, r_max=30, height=2, sections=64)
        plate.export(str(path))

    call = _command("part", "{}", "-o", "{}-folder")
    return [
        Ambiguous(question="unit", name=f"plate.{kind}", content=write, read=call)
        for kind in ("stl", "obj", "ply")
    ]


def _calibrations() -> list[Ambiguous]:
    def matrix(name: str, values: NDArray[np.float64]) -> str:
        rows = np.atleast_2d(values)
        return (
            f"{name}: !!opencv-matrix\n   rows: {rows.shape[0]}\n   cols: {rows.shape[1]}\n"
            f"   dt: d\n   data: [ {', '.join(repr(float(x)) for x in rows.ravel())} ]\n"
        )

    def pair(a: str, b: str, first: str, second: str) -> str:
        k = np.array([[1800.0, 0, 800], [0, 1800, 600], [0, 0, 1]])
        other = np.array([[1700.0, 0, 640], [0, 1700, 400], [0, 0, 1]])
        lens = np.array([[-0.05, 0.1, 0, 0, 0]])
        turn = np.eye(3)
        return (
            "%YAML:1.0\n---\n" + matrix(a, k) + matrix(b, other) + matrix(first, lens)
            + matrix(second, lens / 2) + matrix("Q", turn) + matrix("q", np.array([[-120.0], [0],
                                                                                 [0]]))
        )  # fmt: skip

    call = _command(
        *("sensor", "{}", "--name", "x", "--exposures", "1", "100", "--working-distance", "300"),
        *("900", "--image-size", "1600", "1200", "-o", "{}.json"),
    )
    texts = {
        "letters.yml": pair("A", "B", "u", "v"),
        "words.yml": pair("alpha", "beta", "gamma", "delta"),
        "devices.yml": pair("device_x", "device_y", "lens_x", "lens_y"),
    }
    return [
        Ambiguous(question="keys", name=name, content=text, read=call)
        for name, text in texts.items()
    ]


def _recordings() -> list[Ambiguous]:
    """Folders whose names give exposure times without a unit."""

    def write(names: Sequence[str]) -> Callable[[Path], object]:
        def writer(path: Path) -> None:
            path.mkdir()
            grey = np.full((40, 60), 90, np.uint8)
            for name in names:
                cv2.imwrite(str(path / f"{name}.png"), grey)
                np.save(path / f"{name}.npy", np.full((40, 60, 3), 500.0, np.float32))
            (path / "list.csv").write_text(
                "name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm\nh,hole,0,0,0,0,0,1,6\n"
            )
            pose = np.diag([1.0, -1.0, -1.0, 1.0])
            pose[2, 3] = 500.0
            np.savetxt(path / "pose.txt", pose)

        return writer

    call = _command(
        *("collect", "{}", "--name", "P{view}_{exposure}"),
        *("--features", "{}/list.csv", "--sensor", "rc-visard-65", "--poses", "{}/pose.txt"),
        *("-o", "{}-campaign"),
    )
    return [
        Ambiguous(
            question="exposure",
            name=f"recording{i}",
            content=write([f"P{view:02d}_{time}" for view in (1, 2) for time in times]),
            read=call,
        )
        for i, times in enumerate(((7, 14), (1, 2), (500, 900)))
    ]


def ambiguous() -> list[Ambiguous]:
    """Return every ambiguous file, each of which must be asked about."""
    return [
        *_clouds(),
        *_features(),
        *_tables(),
        *_poses(),
        *_meshes(),
        *_calibrations(),
        *_recordings(),
    ]
