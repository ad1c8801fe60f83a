"""Files as other programs write them, and what each of them means: `DIALECTS`.

Every entry writes a file of known content in some program's way; it must be read back as that
content. Calibrations go through ``exposight sensor``, the others through the library.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from exposight.cell import read_cloud, read_features, read_sensor
from exposight.cli import main
from exposight.geometry import parse_pose, read_pose
from exposight.observing import read_observations

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """One way to write a file.

    Parameters
    ----------
    kind : str
        What the file holds: cloud, calibration, features, table or pose.
    name : str
        The file's name, which says which way it is.
    write : callable
        Writes it.
    read : callable
        Returns what it was read as.
    truth : array
        What it must have been read as.
    within : float
        How far numbers may be off, for the digits that were written.
    """

    kind: str
    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], Any]
    truth: Floats
    within: float = 1e-3

    def fault(self, folder: Path) -> str:
        """Write and read it; say what is wrong, or return an empty text."""
        path = folder / self.name
        try:
            self.write(path)
            got = np.asarray(self.read(path), dtype=np.float64)
        except Exception as error:  # whatever comes is the finding
            return f"{type(error).__name__}: {error}"
        if got.shape != self.truth.shape:
            return f"shape {got.shape} instead of {self.truth.shape}"
        if not np.allclose(got, self.truth, atol=self.within, rtol=1e-6, equal_nan=True):
            return f"off by up to {np.nanmax(np.abs(got - self.truth)):g}"
        return ""


def _text(text: str, encoding: str = "utf-8", newline: str = "\n") -> Callable[[Path], object]:
    return lambda path: path.write_bytes(text.replace("\n", newline).encode(encoding))


def _bytes(data: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(data)


# -- clouds --------------------------------------------------------------------------------------

_ROWS, _COLUMNS = 9, 14


def _grid() -> Floats:
    """Return an organised cloud, mm, a fifth of its points missing."""
    rng = np.random.default_rng(5)
    v, u = np.mgrid[0:_ROWS, 0:_COLUMNS]
    points = np.dstack([u * 3.25 - 20.125, v * 3.5 - 12.0625, 480.5 + rng.normal(0, 4, u.shape)])
    points[rng.random(u.shape) < 0.2] = np.nan
    return np.asarray(points.round(4))


_CLOUD = _grid()
_FLAT = _CLOUD.reshape(-1, 3)
_DENSE = _FLAT[np.isfinite(_FLAT[:, 0])]
_NUMBER = len(_FLAT)
_SIZE = f"obj_info num_cols {_COLUMNS}\nobj_info num_rows {_ROWS}\n"
_XYZ = "property float x\nproperty float y\nproperty float z\n"


def _ply(body: bytes | str, *, kind: str = "ascii", head: str = _SIZE, vertex: str = _XYZ) -> bytes:
    text = f"ply\nformat {kind} 1.0\n{head}element vertex {_NUMBER}\n{vertex}end_header\n"
    return text.encode() + (body.encode() if isinstance(body, str) else body)


def _lines(points: Floats, separator: str = " ", missing: str = "nan", decimal: str = ".") -> str:
    def row(point: Floats) -> str:
        cells = [missing if np.isnan(x) else f"{x:.4f}".replace(".", decimal) for x in point]
        return separator.join(cells)

    return "\n".join(map(row, points)) + "\n"


def _range_grid(binary: bool) -> bytes:
    index = np.full(_NUMBER, -1)
    valid = np.isfinite(_FLAT[:, 0])
    index[valid] = np.arange(valid.sum())
    kind = "binary_big_endian" if binary else "ascii"
    head = (
        f"ply\nformat {kind} 1.0\nobj_info is_mesh 0\n{_SIZE}element vertex {len(_DENSE)}\n{_XYZ}"
        f"element range_grid {_NUMBER}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if not binary:
        cells = "".join("0\n" if i < 0 else f"1 {i}\n" for i in index)
        return head + (_lines(_DENSE) + cells).encode()
    cells_ = b"".join(b"\0" if i < 0 else struct.pack(">Bi", 1, i) for i in index)
    return head + bytes(_DENSE.astype(">f4").tobytes()) + cells_


def _pcd(header: str, body: bytes | str) -> Callable[[Path], object]:
    return _bytes(header.encode() + (body.encode() if isinstance(body, str) else body))


def _padded() -> bytes:
    rows = np.zeros(_NUMBER, [("xyz", "<f4", 3), ("pad", "u1", 4), ("rgb", "<u4")])
    rows["xyz"] = _FLAT
    return bytes(rows.tobytes())


def _pcd_head(fields: str, sizes: str, types: str, counts: str | None, data: str) -> str:
    count = "" if counts is None else f"COUNT {counts}\n"
    return (
        f"VERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\n{count}WIDTH {_COLUMNS}\n"
        f"HEIGHT {_ROWS}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {_NUMBER}\nDATA {data}\n"
    )


def _by_pixel(separator: str, decimal: str) -> str:
    names = separator.join(("Zeile", "Spalte", "X [mm]", "Y [mm]", "Z [mm]"))
    names = names.replace("Zeile", "row").replace("Spalte", "col")
    rows = [names]
    for r in range(_ROWS):
        for c in range(_COLUMNS):
            if np.isfinite(_CLOUD[r, c, 0]):
                cells = [f"{x:.4f}".replace(".", decimal) for x in _CLOUD[r, c]]
                rows.append(separator.join([str(r), str(c), *cells]))
    if np.isnan(_CLOUD[-1, -1, 0]):  # the last pixel tells the size
        rows.append(separator.join([str(_ROWS - 1), str(_COLUMNS - 1), "0", "0", "0"]))
    return "\n".join(rows) + "\n"


def _e57(path: Path) -> None:
    pye57: Any = importlib.import_module("pye57")  # an extra, without types

    with contextlib.closing(pye57.E57(str(path), mode="w")) as file:
        file.write_scan_raw(
            {
                "cartesianX": _DENSE[:, 0] / 1000,
                "cartesianY": _DENSE[:, 1] / 1000,
                "cartesianZ": _DENSE[:, 2] / 1000,
            }
        )


def _clouds() -> list[Dialect]:
    def organised(name: str, write: Callable[[Path], object], within: float = 1e-3) -> Dialect:
        return Dialect(
            kind="cloud", name=name, write=write, read=_points, truth=_CLOUD, within=within
        )

    def flat(
        name: str, write: Callable[[Path], object], truth: Floats = _DENSE, within: float = 1e-3
    ) -> Dialect:
        return Dialect(
            kind="cloud", name=name, write=write, read=_points, truth=truth, within=within
        )

    triple = np.repeat(_FLAT, 1, axis=0)
    numbered = "\n".join(f"{i};{line}" for i, line in enumerate(_lines(_DENSE, ";").split(), 1))
    texts = [
        flat("blanks.xyz", _text(_lines(_DENSE))),
        flat("semicolons.xyz", _text(_lines(_DENSE, ";"))),
        flat("decimal-comma.txt", _text(_lines(_DENSE, "\t", decimal=","), newline="\r\n")),
        flat("decimal-comma-semicolons.csv", _text("X;Y;Z\n" + _lines(_DENSE, ";", decimal=","))),
        flat("count-line.pts", _text(f"{len(_DENSE)}\n" + _lines(np.c_[_DENSE, _DENSE[:, :1]]))),
        flat("cloudcompare.asc", _text(f"//X Y Z\n{len(_DENSE)}\n" + _lines(_DENSE))),
        flat("hash-comments.asc", _text("# exported 12:30\n# x y z\n" + _lines(_DENSE))),
        flat("commas.txt", _text(_lines(_DENSE, ", "))),
        flat("tabs-metres.txt", _text("X [m]\tY [m]\tZ [m]\n" + _metres("\t"))),
        flat("windows-missing.xyz", _text(_lines(_FLAT, missing="-nan(ind)")), truth=_FLAT),
        flat("utf16.csv", _text("x_mm,y_mm,z_mm\n" + _lines(_DENSE, ","), "utf-16")),
        flat("numbered.csv", _text("Nr;X [mm];Y [mm];Z [mm]\n" + numbered + "\n")),
        flat("colours-first.csv", _text("R,G,B,X,Y,Z\n" + _lines(_with_grey(), ","))),
        organised("pixels.csv", _text(_by_pixel(";", ","), newline="\r\n")),
    ]
    e57 = flat("scan.e57", _e57, within=2e-3)
    binary = [
        organised("ascii.ply", _bytes(_ply(_lines(_FLAT)))),
        organised("windows.ply", _bytes(_ply(_lines(_FLAT, missing="-1.#IND00")))),
        organised("nan-ind.ply", _bytes(_ply(_lines(_FLAT, missing="-nan(ind)")))),
        organised(
            "big-endian.ply",
            _bytes(_ply(triple.astype(">f4").tobytes(), kind="binary_big_endian")),
        ),
        organised(
            "upper-case-doubles.ply",
            _bytes(
                _ply(
                    _FLAT.astype("<f8").tobytes(),
                    kind="binary_little_endian",
                    head=f"comment width {_COLUMNS}\ncomment height {_ROWS}\n",
                    vertex=_XYZ.replace("float", "double")
                    .replace(" x", " X")
                    .replace(" y", " Y")
                    .replace(" z", " Z"),
                )
            ),
        ),
        organised("range-grid.ply", _bytes(_range_grid(binary=False))),
        organised("range-grid-binary.ply", _bytes(_range_grid(binary=True))),
        organised(
            "padding.pcd",
            _pcd(
                _pcd_head("x y z _ rgb", "4 4 4 1 4", "F F F U U", "1 1 1 4 1", "binary"), _padded()
            ),
        ),
        organised(
            "no-count.pcd",
            _pcd(
                _pcd_head("x y z", "4 4 4", "F F F", None, "ascii").replace("0.7", "0.6"),
                _lines(_FLAT),
            ),
        ),
        organised(
            "lower-case.pcd",
            _pcd(
                "# .PCD v.7 - Point Cloud Data\n"
                + _pcd_head("X Y Z", "8 8 8", "F F F", "1 1 1", "binary"),
                _FLAT.astype("<f8").tobytes(),
            ),
        ),
        organised("not-what-it-says.txt", _bytes(_ply(_lines(_FLAT)))),
    ]
    return [*texts, *binary, e57]


def _points(path: Path) -> Floats:
    return np.asarray(read_cloud(path).points, dtype=np.float64)


def _metres(separator: str) -> str:
    return "\n".join(separator.join(f"{x / 1000:.7f}" for x in point) for point in _DENSE) + "\n"


def _with_grey() -> Floats:
    return np.hstack([np.full((len(_DENSE), 3), 90.0), _DENSE])


# -- calibrations --------------------------------------------------------------------------------

_K = np.array([[1835.25, 0, 803.5], [0, 1837.75, 611.25], [0, 0, 1]])
_KP = np.array([[1710.5, 0, 630.25], [0, 1712.0, 771.5], [0, 0, 1]])
_D, _DP = [-0.0731, 0.1215, 0.0003, -0.0009, 0.0], [0.011, -0.061, 0.0004, 0.0006, 0.0]
_R = Rotation.from_euler("y", 16.5, degrees=True).as_matrix()
_T = np.array([-131.25, 2.75, 18.5])
_CAMERA = np.array([1835.25, 1837.75, 803.5, 611.25, 1608, 1232])
_LENS = np.array(_D)
_PLACE = -_R.T @ _T
"""Where the second device stands, seen from the camera."""


def _matrix(name: str, values: Any, indent: str = "") -> str:
    rows = np.atleast_2d(np.asarray(values, dtype=float))
    data = ", ".join(repr(float(x)) for x in rows.ravel())
    text = (
        f"{name}: !!opencv-matrix\n   rows: {rows.shape[0]}\n   cols: {rows.shape[1]}\n   dt: d\n"
        f"   data: [ {data} ]\n"
    )
    return "".join(f"{indent}{line}\n" for line in text.splitlines())


def _pair(k: str, d: str, kp: str, dp: str, r: str = "R", t: str = "T") -> str:
    column = _T[:, None]
    return "%YAML:1.0\n---\n" + "".join(
        (_matrix(k, _K), _matrix(d, [_D]), _matrix(kp, _KP), _matrix(dp, [_DP]),
         _matrix(r, _R), _matrix(t, column))
    )  # fmt: skip


_IMAGE = ["--image-size", "1608", "1232"]
_LIGHT = ["--projector-size", "1280", "800"]


def _sensor(*options: str, second: str = "", place: bool = False) -> Callable[[Path], Floats]:
    """Return a reader through the command line: intrinsics, distortion, the second's place."""

    def read(path: Path) -> Floats:
        out = path.with_suffix(".sensor.json")
        call = ["sensor", str(path), *([str(path.with_name(second))] if second else [])]
        call += ["--name", "x", "--exposures", "1", "100", "--working-distance", "300", "900"]
        call += ["-o", str(out), *options, "--json"]
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
            status = main(call)
        if status:
            text = said.getvalue()
            with contextlib.suppress(ValueError):
                text = json.loads(text)["error"]["message"]
            raise ValueError(text)
        sensor = read_sensor(out)
        lens = sensor.camera
        found = [lens.fx, lens.fy, lens.cx, lens.cy, lens.width, lens.height]
        found += [*lens.distortion, *([0.0] * (5 - len(lens.distortion)))]
        if place and sensor.projector is not None:
            found += list(sensor.projector.camera_from_projector.translation_mm)
        elif place:
            found += list(sensor.first_from_camera[1].translation_mm)
        return np.array(found)

    return read


def _calibration(
    name: str,
    text: str | Callable[[Path], object],
    *options: str,
    second: str = "",
    place: bool = False,
    camera: Floats = _CAMERA,
    lens: Floats = _LENS,
) -> Dialect:
    truth = np.concatenate([camera, lens, _PLACE if place else []])
    return Dialect(
        kind="calibration",
        name=name,
        write=_text(text) if isinstance(text, str) else text,
        read=_sensor(*options, second=second, place=place),
        truth=truth,
        within=1e-3,
    )


def _calibrations() -> list[Dialect]:
    both = [*_IMAGE, *_LIGHT]
    nested = {"camera_matrix": _K.tolist(), "dist_coeff": [_D]}
    size = {"image_width": 1608, "image_height": 1232}
    k = ", ".join(map(str, _K.ravel()))
    ros = (
        f"image_width: 1608\nimage_height: 1232\ncamera_name: left\ncamera_matrix:\n  rows: 3\n"
        f"  cols: 3\n  data: [{k}]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n"
        "  rows: 1\n  cols: 5\n  data: [{d}]\nrectification_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nprojection_matrix:\n  rows: 3\n  cols: 4\n"
        f"  data: [{', '.join(map(str, np.c_[_K, np.zeros(3)].ravel()))}]\n"
    )
    echo = (
        "header:\n  stamp:\n    sec: 3\n    nanosec: 7\n  frame_id: cam\nheight: 1232\n"
        "width: 1608\ndistortion_model: plumb_bob\nd:\n"
        + "".join(f"- {x}\n" for x in _D)
        + "k:\n"
        + "".join(f"- {x}\n" for x in _K.ravel())
        + "r:\n"
        + "".join(f"- {x}\n" for x in np.eye(3).ravel())
        + "p:\n"
        + "".join(f"- {x}\n" for x in np.c_[_K, np.zeros(3)].ravel())
        + "binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n"
        "  width: 0\n  do_rectify: false\n---\n"
    )
    ini = (
        "# oST version 5.0 parameters\n\n[image]\n\nwidth\n1608\n\nheight\n1232\n\n[narrow]\n\n"
        "camera matrix\n"
        + "\n".join(" ".join(f"{x:f}" for x in row) for row in _K)
        + "\n\ndistortion\n"
        + " ".join(f"{x:f}" for x in _D)
        + "\n\nrectification\n1 0 0\n0 1 0\n0 0 1\n\nprojection\n"
        + "\n".join(" ".join(f"{x:f}" for x in row) for row in np.c_[_K, np.zeros(3)])
        + "\n"
    )
    xml = (
        '<?xml version="1.0"?>\n<opencv_storage>\n'
        + "".join(
            f'<{name} type_id="opencv-matrix">\n  <rows>{a.shape[0]}</rows>\n'
            f"  <cols>{a.shape[1]}</cols>\n  <dt>d</dt>\n  <data>\n"
            f"    {' '.join(repr(float(x)) for x in a.ravel())}</data></{name}>\n"
            for name, a in (
                ("CameraMatrix", _K),
                ("CameraDistortion", np.array([_D])),
                ("ProjectorMatrix", _KP),
                ("ProjectorDistortion", np.array([_DP])),
                ("Rotation", _R),
                ("Translation", _T[:, None]),
            )
        )
        + "</opencv_storage>\n"
    )
    zivid = (
        "__version__:\n  serializer: 1\n  data: 2\nCameraIntrinsics:\n  CameraMatrix:\n"
        f"    CX: {_K[0, 2]}\n    CY: {_K[1, 2]}\n    FX: {_K[0, 0]}\n    FY: {_K[1, 1]}\n"
        f"  Distortion:\n    K1: {_D[0]}\n    K2: {_D[1]}\n    K3: 0\n    P1: {_D[2]}\n"
        f"    P2: {_D[3]}\n"
    )
    one_based = _K + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    other = _KP + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    matlab = json.dumps(
        {
            "CameraParameters1": {
                "IntrinsicMatrix": one_based.T.tolist(),
                "RadialDistortion": _D[:2],
                "TangentialDistortion": _D[2:4],
                "ImageSize": [1232, 1608],
            },
            "CameraParameters2": {
                "IntrinsicMatrix": other.T.tolist(),
                "RadialDistortion": _DP[:2],
                "TangentialDistortion": _DP[2:4],
                "ImageSize": [1232, 1608],
            },
            "RotationOfCamera2": _R.T.tolist(),
            "TranslationOfCamera2": _T.tolist(),
        }
    )
    realsense = json.dumps(
        {"width": 1608, "height": 1232, "ppx": 803.5, "ppy": 611.25, "fx": 1835.25,
         "fy": 1837.75, "model": "brown_conrady", "coeffs": _D}
    )  # fmt: skip
    binned = np.array([917.625, 918.875, 401.5, 305.375, 804, 616])
    keys = (
        "camera_matrix=A,camera_distortion=a,projector_matrix=B,projector_distortion=b,"
        "rotation=Q,translation=q"
    )

    def stereo_sample(path: Path) -> None:
        path.write_text("%YAML:1.0\n---\n" + _matrix("M1", _K) + _matrix("D1", [_D])
                        + _matrix("M2", _KP) + _matrix("D2", [_DP]))  # fmt: skip
        path.with_name("extrinsics.yml").write_text(
            "%YAML:1.0\n---\n" + _matrix("R", _R) + _matrix("T", _T[:, None])
        )

    def npz(path: Path) -> None:
        np.savez(path, mtx=_K, dist=np.array([_D]))

    return [
        _calibration("scan3d.yml", _pair("cam_K", "cam_kc", "proj_K", "proj_kc"), *both,
                     place=True),
        _calibration("german.yml", _pair("Kamera_K", "Kamera_d", "Projektor_K", "Projektor_d"),
                     *both, place=True),
        _calibration("stereo-spelled.yml",
                     _pair("camera_matrix", "camera_distortion", "projector_matrix",
                           "projector_distortion", "rotation", "translation"), *both, place=True),
        _calibration("nested.yaml",
                     "%YAML:1.0\n---\n\"Camera 0\":\n   imageWidth: 1608\n   imageHeight: 1232\n"
                     + _matrix("cameraMatrix", _K, "   ") + _matrix("distCoeffs", [_D[:4]], "   ")
                     + "\"Projector 0\":\n   imageWidth: 1280\n   imageHeight: 800\n"
                     + _matrix("cameraMatrix", _KP, "   ")
                     + _matrix("distCoeffs", [_DP[:4]], "   ")
                     + _matrix("R", _R, "   ") + _matrix("T", _T[:, None], "   "), place=True),
        _calibration("named-by-nobody.yml", _pair("A", "a", "B", "b", "Q", "q"), *both, "--keys",
                     keys, place=True),
        _calibration("matrices.xml", xml, *both, place=True),
        _calibration("intrinsics.yml", stereo_sample, *_IMAGE, second="extrinsics.yml",
                     place=True),
        _calibration("nested-lists.yaml", yaml.safe_dump({**nested, **size})),
        _calibration("nested-lists.json", json.dumps({**nested, **size})),
        _calibration("flow-lists.yaml", yaml.safe_dump({"K": _K.ravel().tolist(), "D": _D,
                                                        "width": 1608, "height": 1232},
                                                       default_flow_style=True)),
        _calibration("ros.yaml", ros.format(d=", ".join(map(str, _D))), "--raw"),
        _calibration("ros-no-commas.yaml", ros.format(d=" ".join(map(str, _D))), "--raw"),
        _calibration("ros2-echo.yaml", echo, "--raw"),
        _calibration("ros2-binned.yaml",
                     echo.replace("binning_x: 0\nbinning_y: 0", "binning_x: 2\nbinning_y: 2"),
                     "--raw", camera=binned),
        _calibration("ost.ini", ini, "--raw"),
        _calibration("zivid.yml", zivid, *_IMAGE),
        _calibration("matlab.json", matlab, place=True),
        _calibration("realsense.json", realsense),
        _calibration("savez.npz", npz, *_IMAGE),
    ]  # fmt: skip


# -- lists of features ---------------------------------------------------------------------------

_HOLES = np.array(
    [[-62.5, -41.25, 0.5, 6.25], [51.75, -44.5, 0.25, 8.5], [-53.25, 46.5, 0.0, 5.125],
     [63.5, 37.25, 0.75, 10.75], [4.25, 2.5, 1.0, 7.0]]
)  # fmt: skip


def _listed(path: Path) -> Floats:
    features = read_features(path)
    found = []
    for feature in features:
        outward = -feature.part_from_feature.rotation[:, 2]
        place = feature.part_from_feature.translation_mm
        found.append([*place, feature.radius_mm, *outward])
    return np.array(found)


def _hole_list(
    header: str,
    row: str,
    *,
    separator: str = ",",
    decimal: str = ".",
    factor: float = 1.0,
    size: float = 1.0,
) -> str:
    lines = [header.replace("|", separator)]
    for i, (x, y, z, r) in enumerate(_HOLES * factor, start=1):
        cells = {"n": f"H{i}", "x": x, "y": y, "z": z, "r": r * size}
        texts = {
            key: value if isinstance(value, str) else f"{value:.6g}".replace(".", decimal)
            for key, value in cells.items()
        }
        lines.append(row.format(**texts).replace("|", separator))
    return "\n".join(lines) + "\n"


def _feature_lists() -> list[Dialect]:
    truth = np.c_[_HOLES, np.tile([0.0, 0.0, 1.0], (len(_HOLES), 1))]

    def listed(
        name: str, text: str, encoding: str = "utf-8", newline: str = "\n", within: float = 1e-3
    ) -> Dialect:
        write = _text(text, encoding, newline)
        return Dialect(
            kind="features", name=name, write=write, read=_listed, truth=truth, within=within
        )

    own = "name|kind|x_mm|y_mm|z_mm|nx|ny|nz|radius_mm"
    row = "{n}|hole|{x}|{y}|{z}|0|0|1|{r}"
    german = "Name|Art|X [mm]|Y [mm]|Z [mm]|I|J|K|Ø [mm]"
    german_row = "{n}|Bohrung|{x}|{y}|{z}|0|0|1|{r}"
    comma = partial(_hole_list, separator=";", decimal=",")
    dmis = "$$ measured by hand\nDMISMN/'part',05.2\nUNITS/MM,ANGDEC\n" + "".join(
        f"F(H{i})=FEAT/CIRCLE,INNER,CART,{x},{y},{z},0.0,0.0,1.0,{2 * r}\n"
        for i, (x, y, z, r) in enumerate(_HOLES, start=1)
    )  # fmt: skip
    inches = "UNITS/INCH,ANGDEC\n" + "".join(
        f"F(H{i})=FEAT/CIRCLE,INNER,CART,$\n  {x / 25.4:.8f},{y / 25.4:.8f},{z / 25.4:.8f},"
        f"0,0,1,{2 * r / 25.4:.8f}\n"
        for i, (x, y, z, r) in enumerate(_HOLES, start=1)
    )
    return [
        listed("own.csv", _hole_list(own, row)),
        listed("excel-german.csv", comma(own, row), "utf-8-sig", "\r\n"),
        listed(
            "excel-cp1252.csv",
            comma(german, german_row, size=2.0),
            "cp1252",
            "\r\n",
        ),
        listed(
            "tabs-utf16.txt",
            _hole_list(german, german_row, separator="\t", decimal=",", size=2.0),
            "utf-16",
            "\r\n",
        ),
        listed(
            "diameter.csv",
            _hole_list(own.replace("radius_mm", "diameter_mm"), row, size=2.0),
        ),
        listed("ijk.csv", _hole_list("Feature|Type|X|Y|Z|I|J|K|R", row)),
        listed("circle.csv", _hole_list(own, row.replace("hole", "Circle"))),
        listed(
            "reordered.csv",
            _hole_list(
                "radius_mm|nx|ny|nz|kind|name|z_mm|y_mm|x_mm",
                "{r}|0|0|1|hole|{n}|{z}|{y}|{x}",
            ),
        ),
        listed("extra.csv", _hole_list(own + "|tolerance|remark", row + '|0.1|"see, drawing"')),
        listed("pandas-index.csv", _indexed(_hole_list(own, row))),
        listed(
            "inches.csv",
            _hole_list("name|kind|x_in|y_in|z_in|nx|ny|nz|radius_in", row, factor=1 / 25.4),
            within=2e-3,
        ),
        listed(
            "metres.csv",
            _hole_list("name|kind|X (m)|Y (m)|Z (m)|nx|ny|nz|Radius (m)", row, factor=1e-3),
            within=2e-3,
        ),
        listed("sep-line.csv", "sep=;\n" + comma(own, row), "cp1252", "\r\n"),
        listed(
            "no-kind.csv",
            _hole_list("Name|X [mm]|Y [mm]|Z [mm]|nx|ny|nz|Radius [mm]", row.replace("hole|", "")),
        ),
        listed("cmm.dmi", dmis),
        listed("cmm-inches.dmi", inches, newline="\r\n"),
        listed("plan.qif", _qif()),
    ]


def _indexed(text: str) -> str:
    header, *rows = text.splitlines()
    return "\n".join([f",{header}", *(f"{i},{row}" for i, row in enumerate(rows))]) + "\n"


def _qif() -> str:
    features = "".join(
        f'<CircleFeatureDefinition id="{10 + i}"><InternalExternal>INTERNAL</InternalExternal>'
        f"<Diameter>{2 * r}</Diameter></CircleFeatureDefinition>"
        for i, (*_, r) in enumerate(_HOLES)
    )
    nominal = "".join(
        f'<CircleFeatureNominal id="{30 + i}"><FeatureDefinitionId>{10 + i}</FeatureDefinitionId>'
        f"<Name>H{i + 1}</Name><Location>{x} {y} {z}</Location><Normal>0 0 1</Normal>"
        "</CircleFeatureNominal>"
        for i, (x, y, z, _) in enumerate(_HOLES)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<QIFDocument xmlns="http://qifstandards.org/xsd/'
        'qif3" versionQIF="3.0.0" idMax="99"><FileUnits><PrimaryUnits><LinearUnit><SIUnitName>'
        "meter</SIUnitName><UnitName>mm</UnitName><UnitConversion><Factor>0.001</Factor>"
        "</UnitConversion></LinearUnit></PrimaryUnits></FileUnits><Features>"
        f'<FeatureDefinitions n="{len(_HOLES)}">{features}</FeatureDefinitions>'
        f'<FeatureNominals n="{len(_HOLES)}">{nominal}</FeatureNominals></Features></QIFDocument>\n'
    )


# -- tables of observations ----------------------------------------------------------------------

_OBSERVED = (
    *("feature", "view", "exposure_ms", "p_norm", "i_avg", "x_mm", "y_mm", "z_mm"),
    *("w_deg", "p_deg", "r_deg", "radius_mm"),
)
_NUMBERS = _OBSERVED[2:]


def _observed_rows() -> list[list[Any]]:
    rng = np.random.default_rng(8)
    rows: list[list[Any]] = []
    for view in range(6):
        for hole in range(4):
            x, y, z = (rng.uniform(-120, 120, 3) * (1, 0.7, 0.4)).round(2)
            w, p = rng.uniform(-18, 18, 2).round(2)
            for time_ms in (4.5, 12.0, 31.5, 80.0):
                grey = float(min(255.0, 2.4 * time_ms + rng.normal(0, 1)))
                good = 1 / (1 + np.exp((14 - grey) / 3)) / (1 + np.exp((grey - 160) / 12))
                rows.append([f"h{hole}", f"v{view}", time_ms, round(float(good), 4),
                             round(grey, 2), float(x), float(y), float(z), float(w), float(p),
                             0.0, 6.25])  # fmt: skip
    return rows


_ROWS_OBSERVED = _observed_rows()


def _table(
    *,
    separator: str = ",",
    decimal: str = ".",
    header: str = "",
    index: bool = False,
    missing: str | None = None,
    scale: dict[str, float] | None = None,
    quoted: bool = False,
) -> str:
    names = header.split("|") if header else _OBSERVED
    lines = [separator.join([*([""] if index else []), *names])]
    for i, row in enumerate(_ROWS_OBSERVED):
        cells = []
        for name, value in zip(_OBSERVED, row, strict=True):
            if missing is not None and i % 11 == 0 and name in {"p_norm", "i_avg"}:
                cells.append(missing)
            elif isinstance(value, str):
                cells.append(f'"{value}"' if quoted else value)
            else:
                number = repr(round(value * (scale or {}).get(name, 1.0), 9))
                cells.append(number.replace(".", decimal))
        lines.append(separator.join([*([str(i)] if index else []), *cells]))
    return "\n".join(lines) + "\n"


def _tables() -> list[Dialect]:
    truth = np.array([row[2:] for row in _ROWS_OBSERVED])
    gaps = truth.copy()
    gaps[::11, 1:3] = np.nan

    def table(
        name: str,
        text: str,
        encoding: str = "utf-8",
        newline: str = "\n",
        truth: Floats = truth,
    ) -> Dialect:
        def read(path: Path) -> Floats:
            return read_observations(path).array(_NUMBERS)

        write = _text(text, encoding, newline)
        return Dialect(kind="table", name=name, write=write, read=read, truth=truth)

    plain = "feature|view|t_exp [ms]|p_norm|i_avg|x [mm]|y [mm]|z [mm]|w [°]|p [°]|r [°]|r [mm]"
    return [
        table("own.csv", _table()),
        table("pandas-index.csv", _table(index=True)),
        table("excel-german.csv", _table(separator=";", decimal=","), "utf-8-sig", "\r\n"),
        table("bom.csv", _table(), "utf-8-sig"),
        table("utf16-tabs.csv", _table(separator="\t"), "utf-16"),
        table("quoted.csv", _table(quoted=True)),
        table("nan.csv", _table(missing="nan"), truth=gaps),
        table("excel-na.csv", _table(separator=";", decimal=",", missing="#NV"), truth=gaps),
        table("na.csv", _table(missing="NA"), truth=gaps),
        table(
            "microseconds.csv",
            _table(
                header="|".join(_OBSERVED).replace("exposure_ms", "exposure_us"),
                scale={"exposure_ms": 1000.0},
            ),
        ),
        table(
            "seconds.csv",
            _table(
                header="|".join(_OBSERVED).replace("exposure_ms", "exposure [s]"),
                scale={"exposure_ms": 0.001},
            ),
        ),
        table("brackets.csv", _table(separator=";", decimal=",", header=plain.replace(
            "r [mm]", "radius [mm]")), "cp1252"),
        table("pipes.csv", _table(separator="|", header="|".join(_OBSERVED))),
    ]  # fmt: skip


# -- poses ---------------------------------------------------------------------------------------

_POSE = np.eye(4)
_POSE[:3, :3] = Rotation.from_euler("xyz", [171.25, 12.5, 33.75], degrees=True).as_matrix()
_POSE[:3, 3] = (24.125, -37.5, 512.25)


def _poses() -> list[Dialect]:
    turn, place = Rotation.from_matrix(_POSE[:3, :3]), _POSE[:3, 3]
    wxyz = np.roll(turn.as_quat(), 1)
    abc = turn.as_euler("ZYX", degrees=True)
    wpr = turn.as_euler("xyz", degrees=True)
    vector = turn.as_rotvec()
    in_metres = (*(place / 1000), *vector)

    def numbers(*values: float, digits: int = 8) -> str:
        return ",".join(f"{x:.{digits}f}" for x in values)

    def printed(name: str, notation: str, text: str) -> Dialect:
        def read(path: Path) -> Floats:
            return parse_pose(notation, path.read_text("utf-8")).to_matrix()

        return Dialect(kind="pose", name=name, write=_text(text), read=read, truth=_POSE)

    def file(name: str, text: str | Callable[[Path], object]) -> Dialect:
        write = _text(text) if isinstance(text, str) else text
        return Dialect(
            kind="pose", name=name, write=write, read=lambda p: read_pose(p).to_matrix(),
            truth=_POSE,
        )  # fmt: skip

    kuka = "{{X {:.6f}, Y {:.6f}, Z {:.6f}, A {:.6f}, B {:.6f}, C {:.6f}".format(*place, *abc)
    halcon = turn.as_euler("XYZ", degrees=True)
    fanuc = (
        "/PROG  SCAN\n/POS\nP[1]{\n   GP1:\n\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        "\tX = {:9.5f}  mm,\tY = {:9.5f}  mm,\tZ = {:9.5f}  mm,\n"
        "\tW = {:9.5f} deg,\tP = {:9.5f} deg,\tR = {:9.5f} deg\n}};\n/END\n"
    )
    rows = ",\n     ".join("[" + ", ".join(f"{x:.9g}" for x in row) + "]" for row in _POSE)
    quaternion = dict(zip("wxyz", map(float, wxyz), strict=True))
    position = dict(zip("xyz", (place / 1000).tolist(), strict=True))
    return [
        printed("kuka-numbers.txt", "kuka", numbers(*place, *abc)),
        printed("kuka-frame.txt", "kuka", kuka + "}"),
        file("kuka-e6pos.txt", kuka + ", S 2, T 10, E1 0.0, E2 0.0}"),
        printed("abb-numbers.txt", "abb", numbers(*place, *wxyz)),
        file(
            "abb-robtarget.txt",
            f"[[{numbers(*place)}],[{numbers(*wxyz)}],[0,-1,0,1],[9E+09,9E+09,9E+09,9E+09,9E+09,"
            "9E+09]]",
        ),
        printed("ur-numbers.txt", "ur", numbers(*(place / 1000), *vector)),
        file("ur-p.txt", f"p[{numbers(*(place / 1000), *vector)}]"),
        file(
            "ur-decimal-comma.txt",
            f"p[{', '.join(f'{x:.8f}'.replace('.', ',') for x in in_metres)}]",
        ),
        printed("fanuc-numbers.txt", "fanuc", numbers(*place, *wpr)),
        file("fanuc.ls", fanuc.replace("{\n", "{{\n", 1).format(*place, *wpr)),
        file(
            "fanuc-pendant.txt",
            "X: {:.4f} Y: {:.4f} Z: {:.4f}\nW: {:.5f} P: {:.5f} R: {:.5f}\n".format(*place, *wpr),
        ),
        file(
            "halcon.dat",
            "# 3D POSE PARAMETERS: rotation and translation\n\n# Used representation type:\nf 0\n\n"
            "# Rotation angles [deg] or Rodriguez vector:\n"
            f"r {' '.join(f'{x % 360:.8f}' for x in halcon)}\n\n# Translation vector (x y z [m]):\n"
            f"t {' '.join(f'{x / 1000:.8f}' for x in place)}\n",
        ),
        file(
            "zivid.yaml",
            f"__version__:\n  serializer: 1\n  data: 1\nFloatMatrix:\n  Data:\n    [{rows}]\n",
        ),
        file("twelve.txt", "\n".join(" ".join(f"{x:.8f}" for x in row) for row in _POSE[:3])),
        file("sixteen.txt", " ".join(f"{x:.8f}" for x in _POSE.ravel())),
        file("transposed.txt", lambda path: np.savetxt(path, _POSE.T)),
        file("numpy-print.txt", np.array2string(_POSE, precision=8, suppress_small=True)),
        file("list.json", json.dumps(_POSE.tolist())),
        file("pose.npy", lambda path: np.save(path, _POSE)),
        file("excel.csv", "\n".join(";".join(f"{x:.8f}".replace(".", ",") for x in row)
                                    for row in _POSE) + "\n"),
        file("ros.yaml", yaml.safe_dump({"position": position, "orientation": quaternion})),
    ]  # fmt: skip


def dialects() -> list[Dialect]:
    """Return every dialect, by kind."""
    return [*_clouds(), *_calibrations(), *_feature_lists(), *_tables(), *_poses()]
