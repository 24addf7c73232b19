"""Fixtures shared by the command tests."""

import json
from typing import Any

import pytest

from app.cli.main import main
from app.common.exit_codes import ExitCode


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Any:
    """The JSON object a command answers with."""

    def asked(*arguments: str) -> dict[str, Any]:
        assert main([*arguments, "--json"]) == ExitCode.DONE
        (line,) = capsys.readouterr().out.splitlines()
        return json.loads(line)

    return asked
