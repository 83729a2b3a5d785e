"""`import pdecodec` is refused in one line without the global interpreter lock, and in subinterpreters."""

from __future__ import annotations

import subprocess
import sys

import pytest

CASES = {
    "free-threaded": (
        "import sys; sys._is_gil_enabled = lambda: False; import pdecodec",
        "pdecodec needs Python's global interpreter lock; set PYTHON_GIL=1, or use the usual build",
    ),
    "subinterpreter": (
        """
import sys
try:
    import _interpreters as interpreters
except ImportError:
    import _xxsubinterpreters as interpreters
number = interpreters.create()
failed = interpreters.run_string(number, f"import sys; sys.path[:] = {sys.path}; import pdecodec")
raise ImportError(failed.msg)  # Python 3.13 returns what the other interpreter raised, 3.11 raises it
""",
        "pdecodec does not run in a subinterpreter; use threads or processes",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_an_interpreter_that_the_core_is_not_safe_in_is_refused_by_the_import(case: str) -> None:
    script, expected = CASES[case]
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith(expected)
