"""What a file that is given as a cloud is, by its content first and by its suffix after that."""

import struct
from collections.abc import Collection
from pathlib import Path

from exposight.cell.cloud_formats.e57 import SIGNATURE as E57_SIGNATURE
from exposight.cell.cloud_formats.pcd import is_pcd
from exposight.errors import FormatError
from exposight.files import recognised

_CLOUDS: tuple[tuple[bytes, str], ...] = (
    *((b"ply" + end, ".ply") for end in (b"\n", b"\r", b" ")),
    (b"\x93NUMPY", ".npy"),
    (E57_SIGNATURE, ".e57"),
)

_KEEP = "keeping missing points so that it stays organised"
_MESH = (
    "a mesh, whose points have lost their pixels: export the scanner's cloud, before it is meshed, "
    f"as PLY or PCD, {_KEEP}; a part's own geometry is no capture"
)
_LAS = "a LAS or LAZ file, which has no missing points: export E57, PLY or PCD instead"
_ZDF = "a Zivid file: export it from Zivid Studio as an organised PLY or PCD (File > Export)"
_IMAGE = (
    "an image: a depth image needs its camera (observe --cloud IMAGE --depth-scale MM, in Python "
    "read_depth_cloud)"
)
_EXR = "an EXR image: save its depth as TIFF of 32 bits or as NPY, and give --depth-scale"
_OTHERS: tuple[tuple[bytes, str], ...] = (
    (b"LASF", _LAS),
    (b"\x89HDF", _ZDF),
    (b"glTF", _MESH),
    (b"\x89PNG", _IMAGE),
    (b"\xff\xd8\xff", _IMAGE),
    (b"II*\0", _IMAGE),
    (b"MM\0*", _IMAGE),
    (b"BM", _IMAGE),
    (b"\x76\x2f\x31\x01", _EXR),
    (b"MATLAB 5.0", "a MATLAB file: save the array as NPY, PLY or CSV"),
    (b"\xd0\xcf\x11\xe0", "a workbook or another document of Office: save its sheet as CSV"),
)
_BY_SUFFIX = {
    **dict.fromkeys((".stl", ".obj", ".glb", ".gltf", ".3mf", ".step", ".stp", ".off"), _MESH),
    **dict.fromkeys((".las", ".laz"), _LAS),
    **dict.fromkeys((".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp"), _IMAGE),
    ".exr": _EXR,
    ".zdf": _ZDF,
    **dict.fromkeys(
        (".xlsx", ".xls", ".ods"), "a workbook: save its sheet as CSV, with x, y and z as columns"
    ),
    **dict.fromkeys(
        (".mrp", ".mraw", ".bag", ".db3", ".praw", ".zmp"),
        "a recording of a vendor's own program: export its cloud as PLY or PCD there",
    ),
}


def cloud_kind(data: bytes, path: Path, suffixes: Collection[str]) -> str:
    """Return the suffix that stands for the format of a cloud's content.

    Parameters
    ----------
    data : bytes
        The whole file, not empty.
    path : Path
        Its name.
    suffixes : collection of str
        Those that can be read.

    Raises
    ------
    FormatError
        If it is no cloud; the message says what to export instead.
    """
    suffix = path.suffix.lower()
    found = next((kind for start, kind in _CLOUDS if data.startswith(start)), "")
    if not found and is_pcd(data):
        found = ".pcd"
    if found:
        if suffix != found:
            recognised(path, f"a {found[1:].upper()} file by its content")
        return found
    advice = next((text for start, text in _OTHERS if data.startswith(start)), "")
    if suffix in suffixes and suffix != ".npy" and advice is _IMAGE and data.startswith(b"BM"):
        advice = ""  # a text may begin so
    if not advice and _is_stl(data):
        advice = _MESH
    if not advice and suffix in suffixes:
        return suffix
    advice = advice or _BY_SUFFIX.get(suffix, "")
    if not advice and _is_text(data):
        recognised(path, "text by its content")
        return ".xyz"
    msg = f"{path}: point clouds are read as {', '.join(suffixes)}, got " + (
        advice or f"the suffix {path.suffix!r}; convert it, {_KEEP}"
    )
    raise FormatError(msg)


def _is_stl(data: bytes) -> bool:
    if data.startswith(b"solid") and b"facet" in data[:1024]:
        return True
    if len(data) < 84:
        return False
    (triangles,) = struct.unpack("<I", data[80:84])
    return bool(triangles > 0 and len(data) == 84 + 50 * triangles)


def _is_text(data: bytes) -> bool:
    start = data[:4096]
    return b"\0" not in start and any(byte in b"0123456789" for byte in start)
