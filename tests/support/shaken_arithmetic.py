"""The plain decoder with disturbed arithmetic: every floating-point result may be off by one unit in the last place."""

from __future__ import annotations

import ast
import itertools
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

PACKAGE = Path(__file__).resolve().parents[2] / "spec" / "decoder"

EXACT = {"read_sequence", "predicted", "Prediction", "in_order"}
"""Functions in which the specification requires every operation to be rounded as written (19)."""

FUNCTIONS = {"sqrt", "cos", "sum", "cumsum", "prod"}
OPERATORS = ast.Add | ast.Sub | ast.Mult | ast.Div | ast.Pow

COUNTER = itertools.count()

Shake = Callable[[Any], Any]


class Renamer(ast.NodeTransformer):
    """Make the decoder's modules import each other under another package's name."""

    def __init__(self, package: str) -> None:
        self._package = package

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST:
        if node.module and node.module.startswith("spec.decoder"):
            node.module = self._package + node.module.removeprefix("spec.decoder")
        return node


class Shaker(Renamer):
    """Wrap sums, differences, products, quotients, powers and function calls in a call of `shake`."""

    def __init__(self, package: str, exempt: set[str]) -> None:
        super().__init__(package)
        self._exempt = exempt

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        return node if node.name in self._exempt else self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        return node if node.name in self._exempt else self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.MatMult):
            return ast.Call(ast.Name("matrix_product", ast.Load()), [node.left, node.right], [])
        return shaken(node) if isinstance(node.op, OPERATORS) else node

    def visit_AugAssign(self, node: ast.AugAssign) -> list[ast.stmt]:
        self.generic_visit(node)
        read = ast.parse(ast.unparse(node.target), mode="eval").body
        return [node, ast.Assign([node.target], shaken(read))]

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        return shaken(node) if isinstance(node.func, ast.Attribute) and node.func.attr in FUNCTIONS else node


def shaken(node: ast.expr) -> ast.Call:
    return ast.Call(ast.Name("shake", ast.Load()), [node], [])


def shaker(seed: int) -> Shake:
    """Return a function that moves a number, or each number of an array, to a neighbouring float or leaves it;
    zero and integers stay.
    """
    random = np.random.default_rng(seed)
    coins = itertools.chain.from_iterable(random.integers(0, 3, 4096).tolist() for _ in itertools.count())

    def shake(value: Any) -> Any:
        if type(value) is float:
            return math.nextafter(value, (-math.inf, value, math.inf)[next(coins)]) if value else value
        if isinstance(value, np.ndarray | np.floating) and value.dtype.kind == "f":
            coin = random.integers(-1, 2, value.shape)
            towards = np.where(coin > 0, value.dtype.type(np.inf), value.dtype.type(-np.inf))
            return np.where((coin == 0) | (value == 0), value, np.nextafter(value, towards))[()]
        return value

    return shake


def matrix_product(shake: Shake) -> Callable[[Any, Any], Any]:
    """Return a product of arrays like `@`, with `shake` applied to every product and every sum, in another order."""

    def multiplied(one: Any, other: Any) -> Any:
        if one.dtype.kind != "f" and other.dtype.kind != "f":
            return one @ other
        left = one[np.newaxis] if one.ndim == 1 else one
        right = other[:, np.newaxis] if other.ndim == 1 else other
        terms = shake(left[..., :, :, np.newaxis] * right[..., np.newaxis, :, :])
        while terms.shape[-2] > 1:
            half = terms.shape[-2] // 2
            sums = shake(terms[..., :half, :] + terms[..., half : 2 * half, :])
            terms = np.concatenate([sums, terms[..., 2 * half :, :]], axis=-2)
        total = terms.sum(axis=-2)
        total = total[..., 0, :] if one.ndim == 1 else total
        return total[..., 0] if other.ndim == 1 else total

    return multiplied


@contextmanager
def decoder(shake: Shake | None, exempt: set[str] = EXACT) -> Iterator[dict[str, ModuleType]]:
    """Import the modules of the plain decoder under other names, with `shake`, if given, in their arithmetic."""
    package = f"shaken_decoder_{next(COUNTER)}"
    parent = ModuleType(package)
    parent.__path__ = []
    sys.modules[package] = parent
    modules: dict[str, ModuleType] = {}

    def load(name: str) -> None:
        if name in modules:
            return
        tree = ast.parse((PACKAGE / f"{name}.py").read_text("utf-8"))
        for node in tree.body:
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("spec.decoder"):
                needed = [node.module.removeprefix("spec.decoder.")]
                for other in [item.name for item in node.names] if node.module == "spec.decoder" else needed:
                    load(other)
        module = modules[name] = ModuleType(f"{package}.{name}")
        if shake:
            module.__dict__.update(shake=shake, matrix_product=matrix_product(shake))
        sys.modules[module.__name__] = module
        setattr(parent, name, module)
        changed = Shaker(package, exempt) if shake else Renamer(package)
        tree = ast.fix_missing_locations(changed.visit(tree))
        exec(compile(tree, f"{name}.py", "exec"), module.__dict__)

    try:
        load("animation")
        yield modules
    finally:
        for module in [parent, *modules.values()]:
            sys.modules.pop(module.__name__, None)


def trace(modules: dict[str, ModuleType]) -> list[tuple[int, int]]:
    """Record the bits that the decoder's range coders read from now on, each with its probability."""
    read: list[tuple[int, int]] = []
    coder = modules["rangecoder"].RangeDecoder
    bit_with = coder.bit_with

    def noted(self: Any, probability: int) -> int:
        bit: int = bit_with(self, probability)
        read.append((probability, bit))
        return bit

    coder.bit_with = noted
    return read
