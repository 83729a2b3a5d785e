"""The layout of three folders side by side that install as one package."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))

HEAVY = ("fileseq", "h5py", "matplotlib", "meshio", "numba", "rich", "scipy", "zstandard")
"""Packages that neither `import pdecodec` nor a help page may load."""


def run_python(*arguments: str, cwd: Path = ROOT, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(path), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, timeout=120, check=False
    )


def test_every_folder_with_modules_is_a_listed_package() -> None:
    found = {
        ".".join(folder.relative_to(ROOT).parts)
        for top in ("pdecodec", "formats", "cli")
        for folder in [ROOT / top, *(ROOT / top).rglob("*")]
        if folder.is_dir() and any(folder.glob("*.py"))
    }
    installed = {name if name.split(".")[0] == "pdecodec" else f"pdecodec.{name}" for name in found}
    assert installed == set(PROJECT["tool"]["setuptools"]["packages"])


def test_the_version_is_the_same_in_code_and_project() -> None:
    import pdecodec

    assert pdecodec.__version__ == PROJECT["project"]["version"]


def test_the_changelog_has_a_dated_entry_for_this_version() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{PROJECT['project']['version']}] - 20" in text


@pytest.mark.parametrize("name", ["cli", "formats"])
def test_a_folder_imported_by_its_bare_name_says_which_name_to_use(name: str) -> None:
    result = run_python("-c", f"import {name}")
    assert result.returncode == 1
    assert f"pdecodec.{name}" in result.stderr


def loaded_after(statement: str) -> set[str]:
    """Which of the heavy packages are loaded after a statement, in a fresh interpreter."""
    code = f"import json, sys\n{statement}\nprint(json.dumps([name for name in {HEAVY!r} if name in sys.modules]))"
    result = run_python("-c", code)
    assert result.returncode == 0, result.stderr
    return set(json.loads(result.stdout.splitlines()[-1]))


def test_importing_the_package_is_light() -> None:
    assert loaded_after("import pdecodec") == set()


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["encode", "--help"], ["decode", "--help"]])
def test_help_pages_are_light(arguments: list[str]) -> None:
    assert loaded_after(f"from pdecodec.cli.main import run\nassert run({arguments!r}) == 0") == set()


def test_every_public_name_can_be_imported() -> None:
    import pdecodec

    for name in pdecodec.__all__:
        assert getattr(pdecodec, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        pdecodec.nothing  # noqa: B018


def setuptools_can_build() -> bool:
    required = PROJECT["build-system"]["requires"][0].partition(">=")[2]
    try:
        return int(importlib.metadata.version("setuptools").split(".")[0]) >= int(required)
    except importlib.metadata.PackageNotFoundError:
        return False


@pytest.mark.skipif(not setuptools_can_build(), reason="the build backend, a recent setuptools, is not installed here")
def test_a_wheel_holds_all_three_folders_as_one_package_and_works_from_elsewhere(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE", "MANIFEST.in"):
        (source / name).write_bytes((ROOT / name).read_bytes())
    for top in ("pdecodec", "formats", "cli"):
        for file in (ROOT / top).rglob("*.py"):
            target = source / file.relative_to(ROOT)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(file.read_bytes())
    (source / "pdecodec" / "py.typed").touch()
    build = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(tmp_path), "."]
    result = run_python(*build, cwd=source, path=tmp_path / "none")
    assert result.returncode == 0, result.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        tops = {name.split("/")[0] for name in archive.namelist()}
        assert {name for name in tops if not name.endswith(".dist-info")} == {"pdecodec"}
        assert "pdecodec/py.typed" in archive.namelist()
        archive.extractall(tmp_path / "installed")
    result = run_python("-m", "pdecodec.cli", "formats", "--json", cwd=tmp_path, path=tmp_path / "installed")
    assert result.returncode == 0, result.stderr
    assert '".pdeanim"' in result.stdout
