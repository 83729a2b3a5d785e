"""The separate folders of the source tree install as one package."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pdecodec import ArraySequence, encode

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))

HEAVY = ("fileseq", "h5py", "meshio", "rich", "scipy", "vl_convert", "zstandard")
"""Packages that neither `import pdecodec` nor a help page may load."""


def run_python(*arguments: str, cwd: Path = ROOT, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(path), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, timeout=300, check=False
    )


def test_all_files_state_one_version_and_the_changelog_tells_what_is_in_it() -> None:
    def printed(*tag: str) -> subprocess.CompletedProcess[str]:
        return run_python("docs/make_release.py", "notes", *tag)

    version = PROJECT["project"]["version"]
    same, other = printed(f"v{version}"), printed("v0.0.9")
    assert same.returncode == 0, same.stderr
    assert "### What you can do" in same.stdout
    assert "## [" not in same.stdout
    assert f"pyproject.toml states {version}, not 0.0.9" in other.stderr
    assert other.stderr.count("\n") == 11, "one line for each file that states a version"


@pytest.mark.parametrize("name", ["batch", "cli", "formats", "player", "report"])
def test_a_folder_imported_by_its_bare_name_says_which_name_to_use(name: str) -> None:
    result = run_python("-c", f"import {name}")
    assert result.returncode == 1
    assert f"pdecodec.{name}" in result.stderr


def loaded_after(statement: str, names: Sequence[str] = HEAVY) -> set[str]:
    """Return the modules that are loaded after a statement in a new interpreter; by default only heavy packages
    are examined.
    """
    code = f"import json, sys\n{statement}\nprint(json.dumps([name for name in {names!r} if name in sys.modules]))"
    result = run_python("-c", code)
    assert result.returncode == 0, result.stderr
    return set(json.loads(result.stdout.splitlines()[-1]))


def test_importing_the_package_is_light() -> None:
    assert loaded_after("import pdecodec, pdecodec.formats") == set()


def as_installed(folder: Path) -> Path:
    """Copy the package to a folder as a wheel lays it out: Python files without bytecode, and the native library."""
    import pdecodec._core

    skipped = shutil.ignore_patterns("__pycache__", "node_modules")
    for target, top in sorted(PROJECT["tool"]["scikit-build"]["wheel"]["packages"].items()):
        shutil.copytree(ROOT / top, folder / target, ignore=skipped, dirs_exist_ok=True)
    shutil.copy2(pdecodec._core.__file__, folder / "pdecodec")
    return folder


def stamps(folder: Path) -> dict[str, int]:
    """Return when each file and folder in a folder was written [ns]."""
    return {str(path.relative_to(folder)): path.stat().st_mtime_ns for path in sorted(folder.rglob("*"))}


def test_an_installation_that_is_read_only_and_without_bytecode_loads_and_writes_no_more(tmp_path: Path) -> None:
    installed, home, work = as_installed(tmp_path / "installed"), tmp_path / "home", tmp_path / "work"
    home.mkdir()
    work.mkdir()
    lines = ("--version", "simulate jelly -o a.npz --frames 3", "encode a.npz a.pdeanim", "info a.pdeanim")
    commands = [line.split() for line in lines]
    script = (
        "import json, sys\nfrom pdecodec.cli.main import run\n"
        "assert run(json.loads(sys.argv[1])) == 0\n"
        "print(json.dumps(sorted(name for name in sys.modules)))"
    )
    # Leave out the site's start-up files, which lead to this checkout.
    paths = os.pathsep.join([str(installed), sysconfig.get_path("purelib")])
    environment = {**os.environ, "PYTHONPATH": paths, "HOME": str(home), "XDG_CACHE_HOME": str(home / "cache")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)

    def loaded(command: list[str], **more: str) -> list[str]:
        done = subprocess.run(
            [sys.executable, "-S", "-c", script, json.dumps(command)],
            cwd=work, env={**environment, **more}, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        names: list[str] = json.loads(done.stdout.splitlines()[-1])
        return names

    folders = [installed, *(path for path in installed.rglob("*") if path.is_dir())]
    before = stamps(installed)
    for folder in folders:
        folder.chmod(0o555)
    try:
        bare = [loaded(command, PYTHONDONTWRITEBYTECODE="1") for command in commands]
        # A user who may write in spite of the modes, such as root, has not written either.
        assert stamps(installed) == before
        assert list(home.iterdir()) == []
        assert {path.name for path in work.iterdir()} == {"a.npz", "a.pdeanim"}
    finally:
        for folder in folders:
            folder.chmod(0o755)
    for _ in range(2):
        shutil.rmtree(work)
        work.mkdir()
        usual = [loaded(command) for command in commands]
    assert any(path.suffix == ".pyc" for path in installed.rglob("*"))
    assert bare == usual


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["encode", "--help"], ["decode", "--help"]])
def test_help_pages_are_light(arguments: list[str]) -> None:
    assert loaded_after(f"from pdecodec.cli.main import run\nassert run({arguments!r}) == 0") == set()


NEEDLESS = ("concurrent.futures", "fileseq", "importlib.metadata", "numpy.ma", "pdecodec.formats.base.onto")
"""Modules that take a tenth of a second to load together, and that showing a file's contents does not need."""


@pytest.mark.parametrize("arguments", ["info a.pdeanim", "decode a.pdeanim b.npz --frames 0", "decode a.pdeanim b.obj"])
def test_looking_at_a_file_loads_little(tmp_path: Path, arguments: str) -> None:
    encode(ArraySequence(np.random.default_rng(0).normal(size=(1, 9, 3))), tmp_path / "a.pdeanim")
    call = f"os.chdir({str(tmp_path)!r})\nassert run({arguments.split()!r}) == 0"
    statement = f"import os\nfrom pdecodec.cli.main import run\n{call}"
    assert loaded_after(statement, NEEDLESS) == set()


def test_every_public_name_can_be_imported() -> None:
    import pdecodec

    for name in pdecodec.__all__:
        assert getattr(pdecodec, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        pdecodec.nothing  # noqa: B018


def test_a_wheel_holds_all_folders_as_one_package_and_works_from_elsewhere(tmp_path: Path) -> None:
    if shutil.which("c++") is None:
        pytest.skip("there is no C++ compiler in the path")
    # Object files of the core that exist in build/ are used: they are those that the wheel contains.
    build = [
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--wheel-dir",
        str(tmp_path),
        str(ROOT),
    ]
    result = run_python(*build)
    assert result.returncode == 0, result.stderr
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.name.split("-")[2:4] == ["cp311", "abi3"], "one wheel for 3.11 and all later ones"
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        tops = {name.split("/")[0] for name in names}
        assert {name for name in tops if not name.endswith(".dist-info")} == {"pdecodec"}
        modules = {
            f"{target}/{file.relative_to(ROOT / top).as_posix()}"
            for target, top in PROJECT["tool"]["scikit-build"]["wheel"]["packages"].items()
            for file in (ROOT / top).rglob("*.py")
        }
        assert modules | {"pdecodec/py.typed", "pdecodec/_core.pyi"} <= set(names)
        assert {"pdecodec/player/pdeanim.wasm", "pdecodec/player/pdeanim.js"} <= set(names)
        assert not any("__pycache__" in name for name in names)
        archive.extractall(tmp_path / "installed")
    # Leave out the site's start-up files, which lead to this checkout.
    path = os.pathsep.join([str(tmp_path / "installed"), sysconfig.get_path("purelib")])
    script = "import sys, pdecodec._core; from pdecodec.cli.main import run; sys.exit(run(['formats', '--json']))"
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    result = subprocess.run(
        [sys.executable, "-S", "-c", script],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert '".pdeanim"' in result.stdout
