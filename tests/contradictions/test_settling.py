import json

import pytest

from exposight.cli.result import Result
from exposight.cli.terminal import print_error
from exposight.contradictions import Contradiction, settle
from exposight.errors import ContradictionError


def contradiction(name, *, is_error=True):
    return Contradiction(check=name, compared="this and that", found="3 px", is_error=is_error)


def test_nothing_found():
    assert settle([None, None]) == ()


def test_warnings_are_returned_once():
    warning = contradiction("spike", is_error=False)
    assert settle([None, warning, contradiction("spike", is_error=False)]) == (warning,)


def test_errors_are_raised_with_all_that_was_found():
    warning, error = contradiction("spike", is_error=False), contradiction("own-pixels")
    with pytest.raises(
        ContradictionError, match=r"this and that: 3 px.*--despite own-pixels"
    ) as it:
        settle([warning, error], despite=())
    assert it.value.contradictions == (warning, error)


def test_an_accepted_error_is_returned():
    error = contradiction("own-pixels")
    assert settle([error], despite=("own-pixels",)) == (error,)
    with pytest.raises(ContradictionError):
        settle([error], despite=("spike",))


def test_what_nothing_can_be_made_of_has_no_way_round():
    with pytest.raises(ContradictionError, match=r"^contradiction: this and that: 3 px$"):
        settle([contradiction("baseline")])


def test_machines_read_them(capsys):
    error = contradiction("own-pixels")
    assert Result(contradictions=(error,)).document()["contradictions"] == (error,)
    print_error("ContradictionError", "no", contradictions=(error,), as_json=True)
    shown = json.loads(capsys.readouterr().out)["error"]["contradictions"]
    assert [each["check"] for each in shown] == ["own-pixels"]
