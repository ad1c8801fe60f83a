import numpy as np
import pytest

from exposight.errors import FormatError, MissingFileError
from exposight.imaging import DecodedMap, read_map, write_map


def map_of(**changes):
    rng = np.random.default_rng(4)
    column = rng.uniform(0, 63, (5, 7))
    column[1, 2] = np.nan
    settings = {
        "column": column, "row": rng.uniform(0, 47, (5, 7)),
        "modulation": rng.uniform(0, 99, (5, 7)).astype(np.float32),
        "flags": rng.integers(0, 16, (5, 7)).astype(np.uint8),
        "projector_width": 64, "projector_height": 48, "exposure_ms": 12.5, "emulated": True,
    }  # fmt: skip
    return DecodedMap(**{**settings, **changes})


@pytest.mark.parametrize("changes", [{}, {"row": None}, {"column": None, "exposure_ms": None}])
def test_what_is_written_is_read_again(tmp_path, changes):
    decoded = map_of(**changes)
    write_map(tmp_path / "map.npz", decoded)
    read = read_map(tmp_path / "map.npz")
    for name, value in vars(decoded).items():
        again = getattr(read, name)
        if isinstance(value, np.ndarray):
            assert again.dtype == value.dtype
            np.testing.assert_array_equal(again, value)
        else:
            assert again == value, name


def test_missing():
    with pytest.raises(MissingFileError, match=r"no decoded map at nowhere\.npz"):
        read_map("nowhere.npz")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_truncated(tmp_path, share):
    path = tmp_path / "map.npz"
    write_map(path, map_of())
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(FormatError, match=r"map\.npz is not a readable decoded map"):
        read_map(path)


def test_a_flipped_byte_is_noticed(tmp_path):
    path = tmp_path / "map.npz"
    write_map(path, map_of())
    data = bytearray(path.read_bytes())
    data[data.index(b"column.npy") + 60] ^= 0x55
    path.write_bytes(bytes(data))
    with pytest.raises(FormatError):
        read_map(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": np.array("cloud")}, "expected the format 'exposight decoded map', got cloud"),
        ({"version": np.array(2)}, "expected version 1 of a decoded map, got 2"),
        ({"flags": np.zeros((5, 8), np.uint8)}, "expected column as float64 of shape"),
        ({"modulation": np.zeros((5, 7))}, "expected modulation as float32 of shape .* float64"),
        ({"projector_size": np.zeros(3)}, "two numbers as projector_size"),
        ({"column": None, "row": None}, "expected column, row or both"),
        ({"emulated": None}, "lacks emulated"),
    ],
)
def test_archives_that_are_no_map(tmp_path, changes, message):
    path = tmp_path / "map.npz"
    write_map(path, map_of())
    with np.load(path) as archive:
        arrays = {**dict(archive), **changes}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(FormatError, match=message):
        read_map(path)
