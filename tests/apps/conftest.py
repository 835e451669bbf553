"""The command line, for the tests of what it does."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from leastaction.apps.cli import main

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def leastaction(capsys: pytest.CaptureFixture[str]) -> Run:
    """Run the command line in this process: its exit code, output and error output."""

    def run(*words: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        captured = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, captured.out, captured.err

    return run
