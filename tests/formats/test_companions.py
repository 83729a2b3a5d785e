"""Files that belong together count once, whichever of them is named."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pdecodec.formats import list_formats, write_sequence
from pdecodec.formats.base.companions import input_files
from tests.support.scene_cases import needed, scene

WRITTEN = sorted(extension for entry in list_formats() if entry.writer for extension in entry.extensions)


@pytest.mark.parametrize("extension", WRITTEN)
def test_a_file_counts_once_by_its_relative_and_its_absolute_path(
    extension: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needed(extension.removeprefix("."))
    per_frame = {one for entry in list_formats() if entry.frame_per_file for one in entry.extensions}
    name = f"clip.####{extension}" if extension in per_frame else f"clip{extension}"
    (tmp_path / "shots").mkdir()
    write_sequence(scene(frames=3), tmp_path / "shots" / name)
    monkeypatch.chdir(tmp_path / "shots")
    written = sorted(file.resolve() for file in Path.cwd().iterdir())
    spellings = (name, f"./{name}", str(tmp_path / "shots" / name), os.path.join("..", "shots", name))
    for spelling in spellings:
        assert sorted(file.resolve() for file in input_files(spelling)) == written, spelling
