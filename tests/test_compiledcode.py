"""Compiled code goes when sources change that it may have been made of, and stays when they have not."""

from __future__ import annotations

from pathlib import Path

from pdecodec.kernels.compiledcode import forget_stale_code


def make_folder(folder: Path) -> Path:
    (folder / "__pycache__").mkdir(parents=True)
    (folder / "loop.py").write_text("one\n")
    (folder / "__pycache__" / "loop.f-3.py311.nbi").touch()
    return folder


def indices(folder: Path) -> int:
    return len(list(folder.glob("__pycache__/*.nbi")))


def test_code_of_unknown_sources_goes_and_that_of_known_ones_stays(tmp_path: Path) -> None:
    kernels, others = make_folder(tmp_path / "kernels"), make_folder(tmp_path / "others")
    assert not forget_stale_code(kernels, (others,))
    assert indices(kernels) == indices(others) == 0
    (kernels / "__pycache__" / "loop.f-3.py311.nbi").touch()
    (others / "__pycache__" / "loop.f-3.py311.nbi").touch()
    assert forget_stale_code(kernels, (others,))
    assert indices(kernels) == indices(others) == 1


def test_code_goes_when_any_source_changes_or_is_renamed(tmp_path: Path) -> None:
    kernels, others = make_folder(tmp_path / "kernels"), make_folder(tmp_path / "others")
    forget_stale_code(kernels, (others,))
    (others / "__pycache__" / "loop.f-3.py311.nbi").touch()
    (kernels / "loop.py").write_text("two\n")
    assert not forget_stale_code(kernels, (others,))
    assert indices(others) == 0
    (kernels / "loop.py").rename(kernels / "round.py")
    assert not forget_stale_code(kernels, (others,))


def test_a_damaged_stamp_or_a_folder_that_is_not_there_does_no_harm(tmp_path: Path) -> None:
    kernels = make_folder(tmp_path / "kernels")
    forget_stale_code(kernels, ())
    (kernels / "__pycache__" / "sources.sha256").write_bytes(b"\xff\xfe")
    assert not forget_stale_code(kernels, (tmp_path / "none",))
    assert forget_stale_code(kernels, (tmp_path / "none",))
