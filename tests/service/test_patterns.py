"""Text made so that a pattern could be tried on it in more ways than there is time for: each answer comes at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

_PATIENCE_S = 120.0  # what was meant to take years does not end by then; all else here takes the start of Python


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "answer"),
    [
        ("from simcore.scenario.suggestions import as_list; print(as_list('1' + '   1' * 40 + ' x'))", ""),
        ("from simcore.scenario.suggestions import as_list; print(as_list('a' + ' , a' * 45 + '-'))", ""),
        (
            "from simcore.scenario.scenario import Scenario\n"
            "try: Scenario.load(' ' * 10**6 + '{')\n"
            "except Exception as error: print(type(error).__name__)",
            "ScenarioError",
        ),
        ("from service.api.served_file import _is_ranges; print(_is_ranges('bytes=' + ', ' * 5000 + 'x'))", "False"),
        ("from service.api.served_file import _is_ranges; print(_is_ranges('bytes=' + '0-9 , ' * 2000))", "True"),
        ("from service.api.middleware.compression import *; print(accepts_gzip('gzip' + ' ' * 10**6 + 'x'))", "False"),
    ],
    ids=["numbers", "words", "name", "ranges", "many ranges", "encoding"],
)
def test_a_text_that_fits_almost_is_refused_at_once(code: str, answer: str) -> None:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=_PATIENCE_S, check=True)
    assert done.stdout.strip() == answer
