"""What is written under a strange name is read back under it."""

from tests.files.strange_names import strange_names_right


def test_files_under_strange_names_are_what_was_written():
    assert strange_names_right() == []
