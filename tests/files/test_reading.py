"""How foreign files are read: answers given, questions asked, remarks collected."""

import pytest

from exposight.errors import AmbiguousError, InputError
from exposight.files import (
    Reading,
    ambiguous,
    collected_remarks,
    current_reading,
    reading_as,
    recognised,
)


def test_answers_are_parsed_and_wrong_ones_named() -> None:
    assert Reading.parse("decimal=comma, size=diameter") == Reading(
        decimal="comma", size="diameter"
    )
    for wrong, fact in (
        ("decimal=dot", "point or comma"),
        ("decmal=comma", "did you mean 'decimal'"),
        ("decimal", "NAME=ANSWER"),
        ("decimal=comma,decimal=point", "twice"),
        ("encoding=klingon", "klingon"),
    ):
        with pytest.raises(InputError, match=fact):
            Reading.parse(wrong)


def test_what_a_caller_gives_goes_before_what_surrounds_it() -> None:
    with reading_as(Reading(decimal="comma", unit="inch")):
        assert current_reading(Reading(unit="mm")) == Reading(decimal="comma", unit="mm")
    assert current_reading() == Reading()


def test_a_question_names_its_answers() -> None:
    error = ambiguous("a.csv", "is 1,234 a fraction?", "decimal", {"comma": "1.234", "point": "1"})
    assert isinstance(error, AmbiguousError)
    assert error.readings == ("decimal=comma", "decimal=point")
    assert "--read-as decimal=comma" in str(error)


def test_remarks_are_collected_once_and_in_order() -> None:
    with collected_remarks() as remarks:
        recognised("a.csv", "semicolons", "decimal comma")
        recognised("a.csv", "semicolons", "decimal comma")
        recognised("b.csv")
    assert list(remarks) == ["a.csv: semicolons, decimal comma"]
