"""pdecodec/_core.pyi describes the compiled module: names, parameters, types of numbers and arrays."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import pdecodec
from pdecodec import _core

STUB = ast.parse((Path(pdecodec.__file__).parent / "_core.pyi").read_text("utf-8"))

DTYPES = {
    "Int32Array": {"int32"},
    "Int64Array": {"int64"},
    "Float32Array": {"float32"},
    "Float64Array": {"float64"},
    "NDArray[np.float32]": {"float32"},
    "NDArray[np.float64]": {"float64"},
    "FloatArray": {"float32", "float64"},
}
PLAIN = {"int", "float", "bool", "bytes", "str", "None"}

CLASSES = {node.name: node for node in STUB.body if isinstance(node, ast.ClassDef)}
FUNCTIONS = {node.name: node for node in STUB.body if isinstance(node, ast.FunctionDef)}
METHODS = {
    f"{name}.{node.name}": node
    for name, owner in CLASSES.items()
    for node in owner.body
    if isinstance(node, ast.FunctionDef) and not node.decorator_list
}


def is_named_tuple(node: ast.ClassDef) -> bool:
    return [ast.unparse(base) for base in node.bases] == ["NamedTuple"]


def found(name: str) -> Any:
    """Return the object with this name in the module; the name may have two parts, as for a method."""
    owner, _, method = name.rpartition(".")
    return getattr(getattr(_core, owner) if owner else _core, method)


def signatures(function: Any) -> Iterator[dict[str, str]]:
    """Yield the parameters and the result of each overload of a function, with the types that nanobind accepts."""
    for text, *_ in function.__nb_signature__:
        plain = re.sub(r"ndarray\[(?:dtype=(\w+), )?[^]]*\]", lambda match: match[1] or "ndarray", text)
        (parsed,) = ast.parse(re.sub(r"= \\\d+", "= 0", plain) + ": ...").body
        assert isinstance(parsed, ast.FunctionDef)
        yield parameters(parsed)


def parameters(function: ast.FunctionDef) -> dict[str, str]:
    types = {one.arg: ast.unparse(one.annotation) for one in function.args.args if one.annotation}
    return {**types, "return": ast.unparse(function.returns) if function.returns else ""}


def test_the_module_and_its_types_have_the_same_names() -> None:
    declared = {*CLASSES, *FUNCTIONS}
    assert declared == {name for name in vars(_core) if not name.startswith("_")}
    for name, node in CLASSES.items():
        if is_named_tuple(node):
            fields = [ast.unparse(one.target) for one in node.body if isinstance(one, ast.AnnAssign)]
            assert list(getattr(_core, name)._fields) == fields
            continue
        members = {one.name for one in node.body if isinstance(one, ast.FunctionDef)}
        members |= {ast.unparse(one.targets[0]) for one in node.body if isinstance(one, ast.Assign)}
        own = {one for one in vars(getattr(_core, name)) if not one.startswith("_") or one == "__len__"}
        if not issubclass(getattr(_core, name), Exception):
            assert members - {"__init__"} == own - {"name", "value"}, name


@pytest.mark.parametrize("name", [*FUNCTIONS, *METHODS])
def test_parameters_have_the_names_and_types_that_the_module_converts(name: str) -> None:
    stub = parameters({**FUNCTIONS, **METHODS}[name])
    overloads = list(signatures(found(name)))
    for types in overloads:
        assert list(types) == list(stub), name
    for parameter, declared in stub.items():
        taken = {types[parameter] for types in overloads}
        if parameter == "return":
            assert not PLAIN & {declared, *taken} or taken == {declared}, name
        elif declared in PLAIN:
            assert taken == {declared}, parameter
        elif declared in DTYPES:
            assert taken == DTYPES[declared], parameter
