"""Images of others: frames, depth, exposure times in EXIF, and decoded maps."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from zlib import compress, crc32

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tests.fuzz.clouds import Fault, cut, wrong_depth
from tests.fuzz.formats import Format, Sample

from exposight.cell import read_depth
from exposight.cell.recordings import exif_exposure_ms
from exposight.imaging import DecodedMap, FrameStack, read_frames, read_map, write_map

_GREY = (np.arange(180) * 7 % 251).astype(np.uint8).reshape(12, 15)
_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def _images(suffix: str, *arrays: NDArray[np.generic]) -> Callable[[Path], list[Sample]]:
    def samples(folder: Path) -> list[Sample]:
        found = []
        for k, array in enumerate(arrays):
            path = folder / f"{k}{suffix}"
            path.write_bytes(cv2.imencode(suffix, array)[1].tobytes())
            found.append(Sample(path))
        return found

    return samples


def _frame(bits: int) -> Callable[[Path], FrameStack]:
    return lambda path: read_frames([path], bit_depth=bits)


def _wrong_frames(stack: FrameStack) -> str:
    frames = stack.frames
    if frames.ndim != 3 or 0 in frames.shape or str(frames.dtype) not in {"uint8", "uint16"}:
        return f"frames are {frames.dtype} of shape {frames.shape}"
    return "levels beyond their bits" if int(frames.max()) >> stack.bit_depth else ""


def _same_frames(one: FrameStack, other: FrameStack) -> bool:
    return np.array_equal(one.frames, other.frames)


# -- PNG ------------------------------------------------------------------------------------------


def _chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """Return the kinds and contents of a PNG's chunks, as far as they can be told."""
    found, at = [], 8
    while at + 8 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def _png(chunks: list[tuple[bytes, bytes]]) -> bytes:
    return _SIGNATURE + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", crc32(kind + body))
        for kind, body in chunks
    )


def _with_sums(_: bytes, data: bytes) -> bytes:
    """Return a PNG whose chunks have right checksums."""
    return _png(_chunks(data))


def _png_bomb(data: bytes, random: Random) -> bytes:
    """Announce other sizes, with the right checksum: of more rows and columns than are there."""
    chunks = _chunks(data)
    sizes = random.choice(
        ((30_000, 30_000), (2**31 - 1, 1), (13, 15), (1000, 15), (0, 15), (12, 0))
    )
    head = struct.pack(">II", sizes[1], sizes[0]) + chunks[0][1][8:]
    return _png([(b"IHDR", head), *chunks[1:]])


@cache
def _packed_zeros() -> bytes:
    return compress(bytes(50_000_000))


def _png_flat(data: bytes, _: Random) -> bytes:
    """Hold what it announces, half a gigapixel of zeros, in a few hundred kilobytes."""
    head = struct.pack(">II", 500_000_000, 1) + _chunks(data)[0][1][8:]
    return _png([(b"IHDR", head), (b"IDAT", _packed_zeros()), (b"IEND", b"")])


_PNG_FAULTS: dict[str, Fault] = {
    "another size": _png_bomb,
    "half a gigapixel": _png_flat,
    "cut off": cut(),
}

# -- TIFF, BMP, JPEG ------------------------------------------------------------------------------


def _tiff_size(data: bytes, random: Random) -> bytes | None:
    """Announce other sizes in a TIFF's directory."""
    (at,) = struct.unpack_from("<I", data, 4)
    (entries,) = struct.unpack_from("<H", data, at)
    places = [
        at + 10 + 12 * k
        for k in range(entries)
        if struct.unpack_from("<H", data, at + 2 + 12 * k)[0] in {256, 257}
    ]
    where = random.choice(places)
    size = random.choice((0, 50_000, 2**31 - 1, 2**32 - 1))
    kind = struct.pack("<HI", 4, 1)
    return data[: where - 6] + kind + struct.pack("<I", size) + data[where + 4 :]


def _bmp_size(data: bytes, random: Random) -> bytes:
    at = random.choice((18, 22))
    size = random.choice((0, 30_000, 2**31 - 1, -(2**31), -30_000))
    return data[:at] + struct.pack("<i", size) + data[at + 4 :]


def _jpeg_size(data: bytes, _: Random) -> bytes:
    at = data.index(b"\xff\xc0")
    return data[: at + 5] + struct.pack(">HH", 65_500, 65_500) + data[at + 9 :]


# -- EXIF -----------------------------------------------------------------------------------------


def _exif_samples(folder: Path) -> list[Sample]:
    found = []
    for suffix in (".jpg", ".png", ".tif"):
        path = folder / f"photo{suffix}"
        exif = Image.Exif()
        exif.get_ifd(0x8769)[0x829A] = 0.0125
        exif[0x010F] = "a camera"
        Image.fromarray(_GREY).save(path, exif=exif)
        found.append(Sample(path))
    return found


def _wrong_exposure(exposure_ms: float | None) -> str:
    if exposure_ms is None or (math.isfinite(exposure_ms) and 0.0 < exposure_ms <= 3.6e6):
        return ""
    return f"an exposure of {exposure_ms} ms"


# -- maps -----------------------------------------------------------------------------------------


def _map_samples(folder: Path) -> list[Sample]:
    random = np.random.default_rng(2)
    decoded = DecodedMap(
        column=random.uniform(0, 63, (5, 7)),
        row=None,
        modulation=random.uniform(0, 99, (5, 7)).astype(np.float32),
        flags=random.integers(0, 16, (5, 7)).astype(np.uint8),
        projector_width=64,
        projector_height=48,
        exposure_ms=12.5,
        emulated=True,
    )
    packed, plain = folder / "map.npz", folder / "plain.npz"
    write_map(packed, decoded)
    with np.load(packed) as archive:
        np.savez(plain, **dict(archive))
    return [Sample(packed), Sample(plain)]


def _wrong_map(decoded: DecodedMap) -> str:
    shape = decoded.flags.shape
    axes = [each for each in (decoded.column, decoded.row) if each is not None]
    if not axes or len(shape) != 2 or any(each.shape != shape for each in axes):
        return "its arrays do not fit together"
    if decoded.modulation.shape != shape or not (decoded.modulation >= 0).all():
        return "modulation is below 0, NaN, or of another shape"
    if any(np.isinf(each).any() for each in axes) or (decoded.flags > 15).any():
        return "infinite coordinates, or flags that mean nothing"
    if min(decoded.projector_width, decoded.projector_height) < 1:
        return "a projector without pixels"
    exposure_ms = decoded.exposure_ms
    if exposure_ms is not None and not 0.0 < exposure_ms < math.inf:
        return f"an exposure of {exposure_ms} ms"
    return ""


def _unsealed_value(name: bytes, old: bytes, new: bytes) -> Fault:
    """Return a fault of an array in an archive that is not packed, with the right checksum."""

    def change(data: bytes, _: Random) -> bytes | None:
        start = data.find(name)
        at = data.find(old, start)
        if start < 0 or at < 0 or data[8:10] != b"\0\0":
            return None
        changed = data[:at] + new + data[at + len(old) :]
        header = re.search(rb"PK\x03\x04.{22}(..)(..)" + name, data, re.DOTALL)
        assert header is not None
        body = header.end() + int.from_bytes(header[2], "little")
        end = data.find(b"PK", body + 1)
        old_sum = struct.pack("<I", crc32(data[body:end]))
        return changed.replace(old_sum, struct.pack("<I", crc32(changed[body:end])))

    return change


_MAP_FAULTS: dict[str, Fault] = {
    "cut off": cut(),
    "no exposure": _unsealed_value(
        b"exposure_ms.npy", struct.pack("<d", 12.5), struct.pack("<d", -1.0)
    ),
    "a projector without pixels": _unsealed_value(
        b"projector_size.npy", struct.pack("<q", 64), struct.pack("<q", -64)
    ),
}

_DEEP = (_GREY.astype(np.uint16) * 200 + 3).astype(np.uint16)
_DEPTH = (_GREY.astype(np.uint16) * 37 + 400).astype(np.uint16)

FORMATS: tuple[Format, ...] = (
    Format(
        "frame PNG, 8 bits",
        _images(".png", _GREY, np.dstack([_GREY] * 3)),
        _frame(8),
        _wrong_frames,
        _PNG_FAULTS,
        sealed=True,
        reseal=_with_sums,
        text=False,
        same=_same_frames,
    ),
    Format(
        "frame PNG, 16 bits",
        _images(".png", _DEEP),
        _frame(16),
        _wrong_frames,
        _PNG_FAULTS,
        sealed=True,
        reseal=_with_sums,
        text=False,
        same=_same_frames,
    ),
    Format(
        "frame TIFF",
        _images(".tif", _DEEP),
        _frame(16),
        _wrong_frames,
        {"another size": _tiff_size, "cut off": cut()},
        text=False,
    ),
    Format(
        "frame BMP",
        _images(".bmp", _GREY),
        _frame(8),
        _wrong_frames,
        {"another size": _bmp_size, "cut off": cut()},
        text=False,
    ),
    Format(
        "frame JPEG",
        _images(".jpg", _GREY),
        _frame(8),
        _wrong_frames,
        {"another size": _jpeg_size, "cut off": cut()},
        text=False,
    ),
    Format("frame PGM", _images(".pgm", _GREY), _frame(8), _wrong_frames, {"cut off": cut()}),
    Format(
        "depth PNG",
        _images(".png", _DEPTH),
        read_depth,
        wrong_depth,
        _PNG_FAULTS,
        sealed=True,
        reseal=_with_sums,
        text=False,
        same=lambda one, other: np.array_equal(one, other, equal_nan=True),
    ),
    Format(
        "depth TIFF",
        _images(".tif", _DEPTH, _DEPTH.astype(np.float32)),
        read_depth,
        wrong_depth,
        {"another size": _tiff_size, "cut off": cut()},
        text=False,
    ),
    Format("EXIF exposure", _exif_samples, exif_exposure_ms, _wrong_exposure, text=False),
    Format("decoded map", _map_samples, read_map, _wrong_map, _MAP_FAULTS, text=False),
)
