"""Point clouds: PLY, PCD, E57, NPY, text, and depth images."""

from __future__ import annotations

import re
import struct
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from random import Random

import cv2
import numpy as np
from numpy.typing import NDArray
from pypcd4.pypcd4 import Encoding, PointCloud
from tests.fuzz.formats import Format, Sample

from exposight.cell import Cloud, read_cloud, read_depth, write_cloud

Fault = Callable[[bytes, Random], bytes | None]

ROWS, COLUMNS = 5, 6
LARGE = (b"1000000", b"4294967295", b"9223372036854775807", b"99999999999999999999999")
"""Counts that no sample has."""


def points() -> NDArray[np.float32]:
    """Return an organised cloud with missing points."""
    random = np.random.default_rng(1)
    cloud = random.uniform(-50.0, 50.0, (ROWS, COLUMNS, 3)) + np.array([0.0, 0.0, 500.0])
    cloud[2, 3] = np.nan
    return cloud.astype(np.float32)


# -- what must hold -------------------------------------------------------------------------------


def wrong_cloud(cloud: Cloud) -> str:
    """Say what is wrong with a cloud: its types, its missing points, or that it is not kept."""
    array = cloud.points
    if array.dtype != np.float32 or array.ndim not in {2, 3} or array.shape[-1] != 3:
        return f"points are {array.dtype} of shape {array.shape}"
    if array.ndim == 3 and 0 in array.shape and array.size != 0:
        return f"an image of {array.shape}"
    finite = np.isfinite(array)
    if np.isinf(array).any() or (finite.any(axis=-1) != finite.all(axis=-1)).any():
        return "a point is missing in part, or infinite"
    if (finite.all(axis=-1) != cloud.valid).any() or (array[cloud.valid] == 0).all(axis=-1).any():
        return "valid is not where points are"
    sigma = cloud.sigma_z_mm
    if sigma is not None and (sigma.shape != cloud.valid.shape or (sigma < 0).any()):
        return "sigma does not fit the points, or is below 0"
    with tempfile.TemporaryDirectory() as folder:
        for name in ("again.ply", "again.npy"):
            path = Path(folder) / name
            write_cloud(path, cloud)
            if not _kept(cloud, read_cloud(path)):
                return f"{name} reads as another cloud"
    return ""


def _kept(cloud: Cloud, again: Cloud) -> bool:
    """Tell whether a cloud read again is the same, but for a place that now stands for missing."""
    if cloud.points.shape != again.points.shape:
        return False
    there = again.valid
    return np.array_equal(cloud.points[there], again.points[there])


def wrong_depth(depth: NDArray[np.float64]) -> str:
    """Say what is wrong with a depth image."""
    if depth.ndim != 2 or depth.dtype != np.float64 or 0 in depth.shape:
        return f"depth is {depth.dtype} of shape {depth.shape}"
    return "depth is infinite or 0" if np.isinf(depth).any() or (depth == 0).any() else ""


# -- faults of headers and of lengths -------------------------------------------------------------


def count_in(pattern: bytes, counts: tuple[bytes, ...] = (b"-1", b"-30", *LARGE)) -> Fault:
    """Return a fault that puts a nonsensical count where the group of a pattern is."""

    def change(data: bytes, random: Random) -> bytes | None:
        found = list(re.finditer(pattern, data[:4000]))
        if not found:
            return None
        one = random.choice(found)
        return data[: one.start(1)] + random.choice(counts) + data[one.end(1) :]

    return change


def line_twice(pattern: bytes, changed: Callable[[bytes], bytes] = lambda line: line) -> Fault:
    """Return a fault that repeats a line of a header, changed or not."""

    def change(data: bytes, _: Random) -> bytes | None:
        found = re.search(pattern, data[:4000])
        if not found:
            return None
        return data[: found.end()] + changed(found[0]) + data[found.end() :]

    return change


def many_lines(pattern: bytes, line: bytes, times: int = 100_000) -> Fault:
    """Return a fault that puts very many lines, numbered, behind one."""

    def change(data: bytes, _: Random) -> bytes | None:
        found = re.search(pattern, data[:4000])
        if not found:
            return None
        lines = b"".join(line % number for number in range(times))
        return data[: found.end()] + lines + data[found.end() :]

    return change


def cut_lines(data: bytes, random: Random) -> bytes:
    """Return the data without its last line at least: a number's last digits are nobody's loss."""
    last = data.rstrip(b"\n").rfind(b"\n")
    return data[: random.randrange(last)]


def cut(share_left: float = 0.0) -> Fault:
    """Return a fault that cuts off at least a byte, and leaves a share."""

    def change(data: bytes, random: Random) -> bytes:
        return data[: random.randrange(int(share_left * len(data)), len(data) - 1)]

    return change


# -- PLY ------------------------------------------------------------------------------------------

_SCALAR = {"float": "f", "uchar": "B", "int": "i"}


def _ply(encoding: str, *, faces: bool = False, grid: bool = False, first: bool = False) -> bytes:
    """Return a PLY file: sigma and a colour, faces behind or before the vertices, or a grid."""
    array = points().reshape(-1, 3)
    kept = np.flatnonzero(np.isfinite(array[:, 0])) if grid else np.arange(len(array))
    vertices = [(*map(float, array[i]), 0.1, 7) for i in kept]
    lists: list[list[int]] = []
    if faces or first:
        lists = [[0, 1, 2], [1, 2, 3, 4]]
    if grid:
        where = {int(i): k for k, i in enumerate(kept)}
        lists = [[where[i]] if i in where else [] for i in range(len(array))]
    vertex = [
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name in ("x", "y", "z", "sigma_z")),
        "property uchar red",
    ]
    name = "range_grid" if grid else "face"
    listed = [f"element {name} {len(lists)}", "property list uchar int vertex_indices"]
    header = ["ply", f"format {encoding} 1.0", "comment made by hand"]
    if grid or not (faces or first):
        header += [f"obj_info num_cols {COLUMNS}", f"obj_info num_rows {ROWS}"]
    header += [*listed, *vertex] if first else [*vertex, *(listed if lists else [])]
    rows = [("ffffB", row) for row in vertices]
    rows_of_lists = [("B" + "i" * len(each), (len(each), *each)) for each in lists]
    body = rows_of_lists + rows if first else rows + rows_of_lists
    text = "\n".join([*header, "end_header", ""]).encode()
    if encoding == "ascii":
        return text + b"".join(b" ".join(b"%g" % v for v in row) + b"\n" for _, row in body)
    order = "<" if "little" in encoding else ">"
    return text + b"".join(struct.pack(order + form, *row) for form, row in body)


def _ply_samples(*encodings: str) -> Callable[[Path], list[Sample]]:
    def samples(folder: Path) -> list[Sample]:
        found = []
        for encoding in encodings:
            for k, options in enumerate(({}, {"faces": True}, {"grid": True}, {"first": True})):
                path = folder / f"{encoding}-{k}.ply"
                path.write_bytes(_ply(encoding, **options))
                found.append(Sample(path))
        return found

    return samples


_PLY_FAULTS: dict[str, Fault] = {
    "a count of elements that is not there": count_in(rb"element \w+ (\d+)"),
    "an element more than there is": count_in(rb"element (?:vertex|face) (\d+)", (b"31", b"32")),
    "a size that does not fit": count_in(rb"obj_info num_\w+ (\d+)", (b"0", *LARGE)),
    "a property twice": line_twice(rb"property float z\n"),
    "an element twice": line_twice(rb"element vertex \d+\nproperty float x\n"),
    "two sizes": line_twice(rb"obj_info num_cols \d+\n", lambda _: b"obj_info num_cols 7\n"),
    "two formats": line_twice(
        rb"format \w+ 1.0\n",
        lambda line: (
            line.replace(b"big", b"little") if b"big" in line else b"format binary_big_endian 1.0\n"
        ),
    ),
    "100 000 properties": many_lines(rb"property float z\n", b"property float a%d\n"),
    "100 000 elements": many_lines(
        rb"property uchar red\n", b"element e%d 1\nproperty uchar a\n", 50_000
    ),
    "cut off": cut(),
}


def _list_count(data: bytes, _: Random) -> bytes | None:
    """Let the last list of a face claim more than the file holds."""
    if b"ascii" in data:
        return data.replace(b"\n4 1 2 3 4\n-", b"\n200 1 2 3 4\n-")  # before the vertices
    if b"element face 2\n" not in data or b"list uchar int vertex_indices\nend_header" not in data:
        return None
    return data[:-17] + b"\xfe" + data[-16:]


_PLY_FAULTS["a list that does not fit"] = _list_count


# -- PCD ------------------------------------------------------------------------------------------


def _pcd_samples(encoding: Encoding) -> Callable[[Path], list[Sample]]:
    def samples(folder: Path) -> list[Sample]:
        array = points()
        if encoding is Encoding.BINARY_COMPRESSED:  # else it would be written as it is
            array = np.round(array / 50.0) * np.float32(50.0)
        grey = np.arange(ROWS * COLUMNS, dtype=np.float32)[:, None]
        made = PointCloud.from_xyzi_points(np.hstack([array.reshape(-1, 3), grey]))
        made.metadata = made.metadata.derive(height=ROWS, width=COLUMNS)
        one, other = folder / "organised.pcd", folder / "list.pcd"
        made.save(one, encoding=encoding)
        plain = PointCloud.from_xyz_points(array.reshape(-1, 3)[:12])
        plain.save(other, encoding=encoding)
        assert (encoding is Encoding.BINARY_COMPRESSED) == (b"compressed" in one.read_bytes())
        return [Sample(one), Sample(other)]

    return samples


_PCD_FAULTS: dict[str, Fault] = {
    "a size that is not there": count_in(rb"\n(?:WIDTH|HEIGHT|POINTS) (\d+)"),
    "a count of numbers": count_in(rb"\nCOUNT (\d+)", (b"0", b"-1", b"1000", *LARGE)),
    "a size of numbers": count_in(rb"\nSIZE (\d+)", (b"0", b"-4", b"3", b"16", *LARGE)),
    "two widths": line_twice(rb"WIDTH \d+\n", lambda _: b"WIDTH 7\n"),
    "two kinds of fields": line_twice(rb"FIELDS [\w ]+\n", lambda _: b"FIELDS z y x i\n"),
    "100 000 fields": lambda data, _: re.sub(
        rb"FIELDS x y z", b"FIELDS x y z" + b"".join(b" a%d" % i for i in range(100_000)), data
    ),
    "a field twice": lambda data, _: re.sub(rb"FIELDS x y z", b"FIELDS x y y", data),
    "cut off": cut(),
}


def _packed_sizes(data: bytes, random: Random) -> bytes | None:
    """Let compressed data announce other lengths."""
    if b"compressed\n" not in data:
        return None
    start = data.index(b"compressed\n") + len(b"compressed\n")
    sizes = [*struct.unpack_from("<II", data, start)]
    at = random.randrange(2)
    sizes[at] = random.choice([0, 1, sizes[at] + 1, 2**31, 2**32 - 1])
    return data[:start] + struct.pack("<II", *sizes) + data[start + 8 :]


# -- NPY, text, E57, depth ------------------------------------------------------------------------


def _npy_samples(folder: Path) -> list[Sample]:
    one, other = folder / "organised.npy", folder / "list.npy"
    np.save(one, points())
    np.save(other, points().reshape(-1, 3).astype(np.float64))
    return [Sample(one), Sample(other)]


NPY_FAULTS: dict[str, Fault] = {
    "a shape that is not there": count_in(rb"\((\d+), \d+", (b"-5", b"0x5", *LARGE)),
    "objects": lambda data, _: data.replace(b"<f4", b"|O ").replace(b"<f8", b"|O "),
    "cut off": cut(),
}


def _text_samples(folder: Path) -> list[Sample]:
    array = points().reshape(-1, 3)
    plain, named, counted = folder / "a.xyz", folder / "b.csv", folder / "c.pts"
    np.savetxt(plain, array, fmt="%.4f")
    rows, columns = np.divmod(np.arange(len(array)), COLUMNS)
    table = np.column_stack([rows, columns, array])[np.isfinite(array[:, 0])]
    form = ["%d", "%d", "%.4f", "%.4f", "%.4f"]
    np.savetxt(named, table, fmt=form, delimiter=",", header="row,col,x,y,z", comments="")
    np.savetxt(counted, array[:12], fmt="%.4f", header="12", comments="")
    return [Sample(plain), Sample(named), Sample(counted)]


_TEXT_FAULTS: dict[str, Fault] = {
    "pixels far out": lambda data, random: re.sub(
        rb"\n4,5,", random.choice((b"\n4,1000000000,", b"\n-4,5,", b"\n4e300,5,")), data
    ),
    "pixels twice": lambda data, _: data.replace(b"\n4,5,", b"\n4,4,"),
}


def _e57_samples(folder: Path) -> list[Sample]:
    import pye57

    path = folder / "scan.e57"
    array = points().reshape(-1, 3).astype(np.float64) / 1000.0
    rows, columns = np.divmod(np.arange(len(array)), COLUMNS)
    invalid = ~np.isfinite(array[:, 0])
    array[invalid] = 0.0
    scan = {f"cartesian{axis}": array[:, k] for k, axis in enumerate("XYZ")}
    scan |= {"rowIndex": rows, "columnIndex": columns}
    scan["cartesianInvalidState"] = invalid.astype(np.int8)
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(scan)
    return [Sample(path)]


_PAGE = 1024


def _with_page_sums(_: bytes, data: bytes) -> bytes:
    """Return an E57 file whose pages have right checksums (CRC-32C, big-endian)."""
    pages = (data[at : at + _PAGE] for at in range(0, len(data), _PAGE))
    return b"".join(
        page[:-4] + struct.pack(">I", _crc32c(page[:-4])) if len(page) == _PAGE else page
        for page in pages
    )


def _crc32c(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc = _CRC[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc ^ 0xFFFFFFFF


def _crc_of(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ (0x82F63B78 if byte & 1 else 0)
    return byte


_CRC = [_crc_of(byte) for byte in range(256)]


def _e57_fault(pattern: bytes, values: tuple[bytes, ...]) -> Fault:
    """Return a fault of the XML, whose length stays, with right checksums."""

    def change(data: bytes, random: Random) -> bytes | None:
        found = list(re.finditer(pattern, data))
        if not found:
            return None
        one = random.choice(found)
        width = one.end(1) - one.start(1)
        value = random.choice([each for each in values if len(each) <= width] or [b"9" * width])
        changed = data[: one.start(1)] + value.rjust(width, b"0") + data[one.end(1) :]
        return _with_page_sums(data, changed)

    return change


_E57_FAULTS: dict[str, Fault] = {
    "a count of points": _e57_fault(rb'recordCount="(\d+)"', (b"99",)),
    "a place of points": _e57_fault(rb'fileOffset="(\d+)"', (b"0", b"7", b"9999")),
    "cut off": cut(),
}


def _depth_samples(suffix: str) -> Callable[[Path], list[Sample]]:
    def samples(folder: Path) -> list[Sample]:
        depth = (np.arange(48).reshape(6, 8) * 37 + 400).astype(np.uint16)
        depth[1, 2] = 0
        kinds = [depth] if suffix == ".png" else [depth, depth.astype(np.float32)]
        found = []
        for k, array in enumerate(kinds):
            path = folder / f"depth-{k}{suffix}"
            if suffix == ".npy":
                np.save(path, array)
            else:
                path.write_bytes(cv2.imencode(suffix, array)[1].tobytes())
            found.append(Sample(path))
        return found

    return samples


def same_cloud(one: Cloud, other: Cloud) -> bool:
    """Tell whether two clouds are equal."""
    return np.array_equal(one.points, other.points, equal_nan=True)


FORMATS: tuple[Format, ...] = (
    Format(
        "PLY cloud, text",
        _ply_samples("ascii"),
        read_cloud,
        wrong_cloud,
        {**_PLY_FAULTS, "cut off": cut_lines},
    ),
    Format(
        "PLY cloud, binary",
        _ply_samples("binary_little_endian", "binary_big_endian"),
        read_cloud,
        wrong_cloud,
        _PLY_FAULTS,
    ),
    Format(
        "PCD cloud, text",
        _pcd_samples(Encoding.ASCII),
        read_cloud,
        wrong_cloud,
        {**_PCD_FAULTS, "cut off": cut_lines},
    ),
    Format(
        "PCD cloud, binary", _pcd_samples(Encoding.BINARY), read_cloud, wrong_cloud, _PCD_FAULTS
    ),
    Format(
        "PCD cloud, compressed",
        _pcd_samples(Encoding.BINARY_COMPRESSED),
        read_cloud,
        wrong_cloud,
        {**_PCD_FAULTS, "lengths of packed data": _packed_sizes},
    ),
    Format("NPY cloud", _npy_samples, read_cloud, wrong_cloud, NPY_FAULTS),
    Format("text cloud", _text_samples, read_cloud, wrong_cloud, _TEXT_FAULTS),
    Format("depth NPY", _depth_samples(".npy"), read_depth, wrong_depth, NPY_FAULTS),
)
if find_spec("pye57") is not None:
    FORMATS += (
        Format(
            "E57 cloud",
            _e57_samples,
            read_cloud,
            wrong_cloud,
            _E57_FAULTS,
            sealed=True,
            reseal=_with_page_sums,
            same=same_cloud,
            slow=True,
        ),
    )
