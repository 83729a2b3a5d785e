"""What several test files need."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of shared sequences: PDECODEC_DATA, or `../shared/data` beside the checkout."""
    checkout = Path(__file__).resolve().parent.parent
    folder = Path(os.environ.get("PDECODEC_DATA", checkout.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("the shared sequences are not here; set PDECODEC_DATA to their folder")
    return folder
