import pytest

from exposight.errors import FileError
from exposight.files import KeptFiles


def test_a_file_is_found_while_what_decides_it_is_the_same(tmp_path):
    kept = KeptFiles(tmp_path, "plan", "scene")
    assert kept.find("a.csv") is None
    kept.keep("a.csv", b"1")
    assert kept.find("a.csv") == kept.path("a.csv")
    assert kept.path("a.csv").read_bytes() == b"1"
    assert KeptFiles(tmp_path, "another plan", "scene").find("a.csv") is None
    assert kept.find("b.csv") is None


@pytest.mark.parametrize("suffix", ["csv", "sha256"])
def test_a_damaged_file_is_made_again(tmp_path, suffix):
    kept = KeptFiles(tmp_path, "plan")
    kept.keep("a.csv", b"1")
    kept.path("a.csv").with_suffix(f".{suffix}").write_bytes(b"\xff")
    assert kept.find("a.csv") is None
    kept.keep("a.csv", b"1")
    assert kept.find("a.csv")


def test_a_writer_killed_before_the_checksum_loses_nothing(tmp_path):
    kept = KeptFiles(tmp_path, "plan")
    kept.path("a.csv").write_bytes(b"1")
    assert kept.find("a.csv")
    kept.path("a.csv").write_bytes(b"2")
    assert kept.find("a.csv") is None


def test_what_is_not_there_cannot_be_sealed(tmp_path):
    with pytest.raises(FileError):
        KeptFiles(tmp_path, "plan").seal("a.csv")
