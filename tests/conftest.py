"""What several test files need."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, so that what fails in one fails in all; PDECODEC_EXAMPLES=new searches further.
settings.register_profile("any", deadline=None)
settings.register_profile("same", deadline=None, derandomize=True)
settings.load_profile("any")
if os.environ.get("PDECODEC_EXAMPLES") != "new":
    settings.load_profile("same")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of shared sequences: PDECODEC_DATA, or `../shared/data` beside the checkout."""
    checkout = Path(__file__).resolve().parent.parent
    folder = Path(os.environ.get("PDECODEC_DATA", checkout.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("the shared sequences are not here; set PDECODEC_DATA to their folder")
    return folder
