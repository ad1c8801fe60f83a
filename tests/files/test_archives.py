"""Arrays and archives whose headers announce more than there is, or what nobody should open."""

from __future__ import annotations

import io
import tracemalloc
import warnings
import zipfile
from contextlib import suppress
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from tests.fuzz.mutators import mutated

from exposight.errors import FormatError
from exposight.files import MOST_MEMBERS, read_array, read_arrays, read_members


def npy(array) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


def npz(compress: bool = False, **arrays) -> bytes:
    buffer = io.BytesIO()
    (np.savez_compressed if compress else np.savez)(buffer, **arrays)
    return buffer.getvalue()


def archive(**contents: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in contents.items():
            file.writestr(name, content)
    return buffer.getvalue()


@settings(deadline=None)
@given(
    arrays_of.arrays(
        st.one_of(
            arrays_of.floating_dtypes(endianness="?"),
            arrays_of.integer_dtypes(endianness="?"),
            arrays_of.unsigned_integer_dtypes(endianness="?"),
            st.just(np.dtype(bool)),
            arrays_of.unicode_string_dtypes(endianness="?"),
        ),
        arrays_of.array_shapes(min_dims=0, min_side=0),
    ),
    st.booleans(),
)
def test_arrays_are_read_as_numpy_reads_them(array, fortran):
    data = npy(np.asfortranarray(array) if fortran else array)
    read = read_array(data, "a.npy", "array", kinds="biufU")
    np.testing.assert_array_equal(read, array)
    assert read.dtype.isnative
    assert read.flags.writeable


@pytest.mark.parametrize("compress", [False, True])
def test_an_archive_gives_its_arrays_by_name(compress):
    data = npz(compress, x=np.arange(3.0), flags=np.array([True, False]))
    read = read_arrays(data, "a.npz", "map")
    np.testing.assert_array_equal(read["x"], [0, 1, 2])
    assert read["flags"].dtype == bool
    assert list(read_arrays(data, "a.npz", "map", wanted="x".__eq__)) == ["x"]


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.array([{}], dtype=object), "Python objects"),
        (np.array([1j]), "complex"),
        (np.zeros(2, dtype=[("x", "f4")]), "records"),
        (np.zeros(2, dtype="M8[s]"), "damaged|type"),
        (np.array(["a"]), "type U1"),
    ],
)
def test_other_values_than_numbers_are_refused(array, said):
    with pytest.raises(FormatError, match=said):
        read_array(npy(array), "a.npy", "cloud")


@pytest.mark.parametrize("shape", [b"(9999999999,)", b"(2, 2, )", b"(1,1,1,1,1,1)"])
def test_a_shape_that_does_not_fit_the_bytes_is_refused_before_memory_is_taken(shape):
    whole = npy(np.zeros(3))
    data = whole.replace(b"(3,), }" + b" " * (len(shape) - 4), shape + b", }")
    assert data != whole
    tracemalloc.start()
    with pytest.raises(FormatError, match="announces"):
        read_array(data, "a.npy", "cloud")
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_bytes_after_an_array_are_refused():
    with pytest.raises(FormatError, match="25 are there"):
        read_array(npy(np.zeros(3)) + b"\0", "a.npy", "cloud")


@pytest.mark.parametrize("array", [np.array([True]), np.array(["x"])])
def test_bytes_that_are_no_values_of_their_type_are_refused(array):
    data = npy(array)
    damaged = data[: -array.itemsize] + b"\xff" * array.itemsize
    with pytest.raises(FormatError, match="bytes that no"):
        read_array(damaged, "a.npy", "cloud", kinds="bU")


def test_an_archive_that_unpacks_to_more_than_its_limit_is_refused():
    data = npz(compress=True, x=np.zeros(1_000_000))
    assert len(data) < 20_000
    with pytest.raises(FormatError, match="7000000 bytes are read"):
        read_arrays(data, "a.npz", "map", most_bytes=7_000_000)


def test_an_archive_that_lies_about_its_size_takes_no_memory():
    data = archive(x=b"0" * 1000)
    lying = data.replace((1000).to_bytes(4, "little"), (900_000_000).to_bytes(4, "little"))
    tracemalloc.start()
    with pytest.raises(FormatError, match="more bytes than its archive can hold"):
        read_members(lying, "a.zip", "map")
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_an_archive_that_unpacks_to_more_than_it_says_is_refused():
    data = archive(x=b"0" * 1000)
    lying = data.replace((1000).to_bytes(4, "little"), (900).to_bytes(4, "little"))
    with pytest.raises(FormatError):
        read_members(lying, "a.zip", "map")


def test_a_name_twice_in_an_archive_is_refused():
    with warnings.catch_warnings(), zipfile.ZipFile(buffer := io.BytesIO(), "w") as file:
        warnings.simplefilter("ignore")
        file.writestr("x", b"1")
        file.writestr("x", b"2")
    with pytest.raises(FormatError, match="twice"):
        read_members(buffer.getvalue(), "a.zip", "map")


def test_an_archive_of_too_many_files_is_refused():
    names = {f"{number}": b"" for number in range(MOST_MEMBERS + 1)}
    with pytest.raises(FormatError, match="1001 files"):
        read_members(archive(**names), "a.zip", "map")


def test_another_compression_is_refused():
    with zipfile.ZipFile(buffer := io.BytesIO(), "w", zipfile.ZIP_LZMA) as file:
        file.writestr("x", b"1")
    with pytest.raises(FormatError, match="deflate"):
        read_members(buffer.getvalue(), "a.zip", "map")


@pytest.mark.parametrize("number", range(300))
def test_damaged_archives_and_arrays_are_refused_or_read(number):
    random = Random(number)
    reader, whole = random.choice(
        [(read_array, npy(np.arange(12.0).reshape(3, 4))), (read_arrays, npz(x=np.ones(5)))]
    )
    with suppress(FormatError):
        reader(mutated(whole, random, text=True), "a", "map")
