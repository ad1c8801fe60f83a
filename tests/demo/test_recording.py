import pytest

from exposight.demo import DATA_VARIABLE, find_skull, read_skull
from exposight.errors import MissingFileError


def test_without_a_recording_the_message_says_what_is_needed(tmp_path):
    with pytest.raises(MissingFileError, match=r"calibration\.xml, skull_gray, skull_2x3.*--data"):
        find_skull(tmp_path)


def test_the_environment_names_the_folder_above(tmp_path, monkeypatch):
    for name in ("skull_gray", "skull_2x3"):
        (tmp_path / "skull" / name).mkdir(parents=True)
    (tmp_path / "skull" / "calibration.xml").touch()
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    assert find_skull() == tmp_path / "skull"


def test_a_folder_that_the_environment_names_wrongly_is_not_passed_over(tmp_path, monkeypatch):
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(MissingFileError, match="nowhere"):
        find_skull()


def test_a_missing_reference_cloud_is_named(real_data, tmp_path):
    whole = real_data / "skull"
    (tmp_path / "calibration.xml").symlink_to(whole / "calibration.xml")
    (tmp_path / "skull_2x3").symlink_to(whole / "skull_2x3")
    (tmp_path / "skull_gray").mkdir()
    for frame in (whole / "skull_gray").glob("*.png"):
        (tmp_path / "skull_gray" / frame.name).symlink_to(frame)
    with pytest.raises(MissingFileError, match=r"pointCloud\.mat"):
        read_skull(find_skull(tmp_path))
