"""Settings of all tests, the folder of shared data, and a table of what was skipped and why."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, so that a failure can be reproduced. PDECODEC_EXAMPLES=new searches further.
settings.register_profile("any", deadline=None)
settings.register_profile("same", deadline=None, derandomize=True)
settings.load_profile("any")
if os.environ.get("PDECODEC_EXAMPLES") != "new":
    settings.load_profile("same")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of shared sequences: PDECODEC_DATA, or `../shared/data` next to the checkout."""
    checkout = Path(__file__).resolve().parent.parent
    folder = Path(os.environ.get("PDECODEC_DATA", checkout.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("the shared sequences are not here; set PDECODEC_DATA to their folder")
    return folder


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print one table of what was skipped: how many tests of which folder, and why."""
    skipped: Counter[tuple[str, str]] = Counter()
    for report in terminalreporter.getreports("skipped"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        skipped[report.nodeid.split("::")[0], reason.removeprefix("Skipped: ")] += 1
    if skipped:
        terminalreporter.section("skipped")
        for (file, reason), count in sorted(skipped.items()):
            terminalreporter.line(f"{count:5}  {file}  {reason}")
