import hashlib

import pytest

from exposight.errors import DamagedFileError, FileError, FormatError, MissingFileError
from exposight.files import read_bytes, read_text, read_verified


def test_what_cannot_be_read_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no list at .*gone\.csv"):
        read_bytes(tmp_path / "gone.csv", "list")
    with pytest.raises(FileError, match="cannot be read"):
        read_bytes(tmp_path, "list")
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match=r"a\.csv is not UTF-8 text; expected a list"):
        read_text(tmp_path / "a.csv", "list")


def test_a_checksum_on_record_is_verified(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"a")
    assert read_verified(path, hashlib.sha256(b"a").hexdigest(), "file") == b"a"
    with pytest.raises(DamagedFileError, match=r"a\.txt is damaged"):
        read_verified(path, hashlib.sha256(b"b").hexdigest(), "file")
