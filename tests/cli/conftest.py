import pytest
from typer.testing import CliRunner

from exposight.cli.app import app


@pytest.fixture(scope="session")
def run():
    """Run the command line in this process, on a terminal of 80 columns."""

    def invoke(*arguments):
        words = [str(argument) for argument in arguments]
        return CliRunner().invoke(app, words, env={"COLUMNS": "80"})

    return invoke
