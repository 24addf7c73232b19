"""What the tests of several commands need."""

import json
from typing import Any

import pytest

from app.exits import DONE
from app.main import main


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Any:
    """The JSON object a command answers with."""

    def asked(*arguments: str) -> dict[str, Any]:
        assert main([*arguments, "--json"]) == DONE
        (line,) = capsys.readouterr().out.splitlines()
        return json.loads(line)

    return asked
