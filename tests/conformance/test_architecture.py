"""The structure of the source tree: dependencies point in one direction, and no modules import each other in a circle.

Imports are read from the sources, wherever they stand: an import inside a function can close a circle too.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

Imports = dict[str, set[str]]
"""Files that each file imports, by their paths from the root."""

FACADES = {"pdecodec/__init__.py", "pdecodec/__main__.py", "pdecodec/dask.py"}
"""Files that give public names to objects of any layer. Only users' code may import them."""

PYTHON_LAYERS = (
    *("pdecodec/errors.py", "pdecodec/system", "pdecodec/mesh", "pdecodec/simulate"),
    *("pdecodec/codec/sections", "pdecodec/codec", "formats/base", "formats"),
    *("player", "batch", "report", "research", "cli", "plugins"),
)
"""Folders and files of the package: each may import from itself and from those before it."""

CORE_LAYERS = (
    *("core/base", "core/entropy", "core/linalg", "core/mesh", "core/text", "core/simulate"),
    *("core/sections", "core/decode/evaluate", "core/decode", "core/encode", "core/bindings", "core/tests"),
)
"""Folders of the core: each may include from itself and from those before it."""

INSTALLED_INSIDE = (
    *("batch", "cli", "formats", "player", "report", "research"),
    *("plugins/ecosystem", "plugins/paraview"),
)
"""Folders that are installed in the package `pdecodec`, by their own names."""


def module_name(path: Path) -> str:
    inside = next((folder for folder in INSTALLED_INSIDE if path.is_relative_to(ROOT / folder)), None)
    parts = path.relative_to((ROOT / inside).parent if inside else ROOT).with_suffix("").parts
    parts = parts[:-1] if parts[-1] == "__init__" else parts
    return ".".join(("pdecodec", *parts) if inside else parts)


def imported_names(source: str, modules: dict[str, str]) -> Iterator[str]:
    """Names of the modules that a source imports."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            for alias in node.names:
                submodule = f"{node.module}.{alias.name}"
                yield submodule if submodule in modules else node.module


def python_imports(*folders: str) -> Imports:
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.py") if "node_modules" not in path.parts]
    modules = {module_name(path): path.relative_to(ROOT).as_posix() for path in files}
    return {
        file: {
            modules[found] for found in imported_names((ROOT / file).read_text("utf-8"), modules) if found in modules
        }
        - {file, *FACADES}
        for file in modules.values()
    }


def core_imports() -> Imports:
    files = list((ROOT / "core").rglob("*.[ch]pp"))
    includes = re.compile(r'^#include "([^"]+)"', re.MULTILINE)
    return {
        path.relative_to(ROOT).as_posix(): {
            f"core/{name}" for name in includes.findall(path.read_text("utf-8")) if (ROOT / "core" / name).exists()
        }
        for path in files
    }


def script_imports() -> Imports:
    files = list((ROOT / "player").rglob("*.js"))
    imports = re.compile(r"""^(?:import|export)\b[^;"']*["'](\.[^"']+)["']""", re.MULTILINE)
    return {
        path.relative_to(ROOT).as_posix(): {
            (path.parent / name).resolve().relative_to(ROOT).as_posix()
            for name in imports.findall(path.read_text("utf-8"))
        }
        for path in files
    }


PYTHON = python_imports("pdecodec", *INSTALLED_INSIDE)

EVERYTHING = {
    "python": PYTHON,
    "tests and specification": python_imports("pdecodec", *INSTALLED_INSIDE, "tests", "spec"),
    "core": core_imports(),
    "player": script_imports(),
}


@pytest.mark.parametrize("part", EVERYTHING)
def test_no_files_import_each_other_in_a_circle(part: str) -> None:
    imports = EVERYTHING[part]
    assert sum(map(len, imports.values())) >= len(imports) / 2, "imports are found"
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        pytest.fail("a circle: " + " -> ".join(error.args[1]))


def layer(file: str, layers: tuple[str, ...]) -> int:
    """Return the index of a file's layer: the one with the longest name that its path begins with."""
    found = [name for name in layers if file == name or file.startswith(f"{name}/")]
    assert found, f"{file} is in no layer"
    return layers.index(max(found, key=len))


@pytest.mark.parametrize(
    ("imports", "layers"), [(PYTHON, PYTHON_LAYERS), (core_imports(), CORE_LAYERS)], ids=["python", "core"]
)
def test_dependencies_point_one_way(imports: Imports, layers: tuple[str, ...]) -> None:
    upwards = [
        f"{file} imports {other}"
        for file, others in imports.items()
        for other in others
        if file not in FACADES and layer(other, layers) > layer(file, layers)
    ]
    assert upwards == []


def test_plugins_use_public_names_alone_and_nothing_needs_them() -> None:
    for file, others in PYTHON.items():
        folder = "/".join(file.split("/")[:2])
        for other in others:
            assert folder in other or not (file.startswith("plugins/") or other.startswith("plugins/")), (file, other)


def test_the_plain_decoder_imports_nothing_of_the_package() -> None:
    for path in (ROOT / "spec" / "decoder").rglob("*.py"):
        names = set(imported_names(path.read_text("utf-8"), {}))
        assert not {name for name in names if name.split(".")[0] in {"pdecodec", "tests"}}, path
