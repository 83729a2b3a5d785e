"""Section 11 of the specification: functions on elements and on the partition tree, and their order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from spec.decoder.contexts import Contexts, choose
from spec.decoder.curves import Points
from spec.decoder.fields import bits
from spec.decoder.groups import PATCH, Model
from spec.decoder.mesh import NONE
from spec.decoder.patches import Patches

MIN_INDEPENDENT_SHARE, MIN_INDEPENDENT_SHARE_OF_PIECES = 2.0**-12, 2.0**-40
SERIES_FUNCTIONS, SERIES_TERMS = 8, 14

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


def local_coordinates(grid: Ints) -> Ints:
    """11.1: return local coordinates, (3, vertices)."""
    n = len(grid)
    away = (grid - grid[0]).T
    x: Ints = n * away - away.sum(axis=1, keepdims=True)
    k = (61 - bits(n)) // 2 - bits(abs(x).max())
    x = x << k if k >= 0 else x >> -k

    def m(p: int, q: int) -> int:
        return int(x[p] @ x[q])

    scale = max(bits(m(0, 0) + m(1, 1) + m(2, 2)) - 30, 0)

    def turn(p: int, q: int) -> bool:
        if (m(p, q) >> scale) ** 2 <= ((m(p, p) >> scale) + 16) * ((m(q, q) >> scale) + 16) >> 8:
            return False
        a, b = (m(q, q) - m(p, p)) >> scale, (2 * m(p, q)) >> scale
        root = math.isqrt(a * a + b * b)
        c = math.isqrt((2**30 + (abs(a) << 30) // root) << 29)
        s = ((b << 29) // root << 30) // c
        s = -s if a < 0 else s
        x[p], x[q] = (c * x[p] - s * x[q]) >> 30, (s * x[p] + c * x[q]) >> 30
        return True

    for _ in range(8):
        if not any([turn(0, 1), turn(0, 2), turn(1, 2)]):
            break
    for j in (0, 1, 0):
        if m(j, j) < m(j + 1, j + 1):
            x[[j, j + 1]] = x[[j + 1, j]]
    return x


def series_functions(x: Floats, rate: float, order: int) -> Floats:
    """11.2: return the series at each argument, (order, arguments)."""
    power = (rate * x) ** order
    found = []
    for j in range(order):
        total = np.ones_like(x)
        for k in range(SERIES_TERMS, 0, -1):
            total = 1.0 + total * (power / math.prod(range(order * (k - 1) + j + 1, order * k + j + 1)))
        found.append(total * x**j / math.factorial(j))
    return np.array(found)


class Functions:
    """11.3: orthonormal rows, added one by one."""

    def __init__(self, size: int, most: int) -> None:
        self.size, self.most = size, most
        self.rows = np.zeros((0, size))

    def add(self, column: Floats, share: float = 0.0) -> bool:
        """Orthogonalise a column and add it; return False if all are there or at most `share` of it is independent."""
        if len(self.rows) == self.most:
            return False
        before = after = column @ column
        for _ in range(2):
            column = column - (self.rows @ column) @ self.rows
            after = column @ column
            if after > 0.125 * before:
                break
        if share and not after > share * before:
            return False
        self.rows = np.vstack([self.rows, column / math.sqrt(after) if after > 0 else 0.0 * column])
        return True

    def complete(self, share: float) -> None:
        """Add unit vectors until all functions are there."""
        for vertex in range(self.size):
            if len(self.rows) == self.most:
                break
            column = np.zeros(self.size)
            column[vertex] = 1.0
            self.add(column, share)

    def padded(self) -> Floats:
        """Return (most, size), padded with zeros."""
        return np.vstack([self.rows, np.zeros((self.most - len(self.rows), self.size))])


def list_exponents() -> list[tuple[int, int, int]]:
    """11.3: list the exponents of the products, affine ones first."""
    affine = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    degrees = range(10 + 1)
    every = [(a, b, c) for a in degrees for b in degrees for c in degrees if a + b + 2 * c <= 10]
    every.sort(key=lambda item: (item[0] + item[1] + 2 * item[2], -item[0], -item[1]))
    return affine + [item for item in every if item not in affine]


EXPONENTS = list_exponents()


def functions_of_element(model: Model, grid: Ints, affine: int) -> Floats:
    """11.3: build the functions of an element, (functions, vertices), of which `affine` are affine."""
    size, threshold = len(grid), 1.0 - model.threshold / 16.0
    functions = Functions(
        size, min(size, model.functions if model.has_affine else min(model.functions, SERIES_FUNCTIONS))
    )
    local = local_coordinates(grid).astype(np.float64)
    for column in [np.ones(size), *local][:affine]:
        functions.add(column)
    if model.kind == PATCH:
        added: dict[tuple[int, ...], Floats] = dict(zip(EXPONENTS[:4], functions.rows, strict=False))
        for item in EXPONENTS[4:]:
            less = [(axis, tuple(n - (i == axis) for i, n in enumerate(item))) for axis in range(3) if item[axis]]
            if all(each in added for _, each in less):
                axis, factor = less[0]
                if functions.add(added[factor] * local[axis], MIN_INDEPENDENT_SHARE * threshold):
                    added[item] = functions.rows[-1]
    else:
        for column in series_functions(piece_parameters(grid), model.rate, SERIES_FUNCTIONS):
            functions.add(column, MIN_INDEPENDENT_SHARE_OF_PIECES * threshold)
    if model.has_affine:
        functions.complete(MIN_INDEPENDENT_SHARE * threshold)
    return functions.padded()


def piece_parameters(grid: Ints) -> Floats:
    """11.3: return u along a piece of a curve."""
    lengths = np.sqrt((np.diff(grid, axis=0).astype(np.float64) ** 2).sum(axis=1))
    along = np.concatenate([[0.0], lengths.cumsum()])
    if along[-1] == 0.0:
        along = np.arange(float(len(grid)))
    return 2.0 * along / along[-1] - 1.0 if along[-1] > 0.0 else along


@dataclass
class Subband:
    """11.6: functions of space that are coded together."""

    first: int
    size: int
    depth: int
    """-1 for an element."""
    affine: int
    """Number of the element's affine functions, which are coded in the subbands of nodes."""
    above: int


@dataclass
class Space:
    """Functions of each element, affine ones first; two-scale matrices and numbers of affine functions of nodes."""

    patches: Patches
    functions: list[Floats]
    matrices: dict[int, Floats]
    counts: list[int]
    subbands: list[Subband]

    def expand(self, coefficients: Floats) -> Floats:
        """11.7: evaluate coefficients (functions, channels) at all places, (channels, places)."""
        children, subbands = self.patches.children, iter(self.subbands)
        affine = {0: coefficients[: next(subbands).size]}
        for node, child in enumerate(children):
            if child != NONE:
                subband = next(subbands)
                wavelets = coefficients[subband.first : subband.first + subband.size]
                both = self.matrices[node].T @ np.vstack([affine[node], wavelets])
                affine[child], affine[child + 1] = both[: self.counts[child]], both[self.counts[child] :]
        values = []
        for functions, node, subband in zip(self.functions, self.patches.node_of, subbands, strict=True):
            others = coefficients[subband.first : subband.first + subband.size]
            values.append(functions.T @ np.vstack([affine[node], others]))
        return np.vstack(values).T


def build_space(model: Model, patches: Patches, grid: Points) -> Space:
    """Build the functions of all elements and nodes."""
    points = np.array(grid, np.int64).reshape(-1, 3)
    share = MIN_INDEPENDENT_SHARE * (1.0 - model.threshold / 16.0)
    counts, kept = read_layout(model, patches)
    coordinates: dict[int, Floats] = {}
    found = []
    for number, (element, node) in enumerate(zip(patches.elements, patches.node_of, strict=True)):
        own = points[element]
        is_still = number >= patches.moving
        functions = np.zeros((0, len(own))) if is_still else functions_of_element(model, own, counts[node])
        found.append(functions)
        monomials = np.vstack([np.ones(len(own)), (own - own[0]).T.astype(np.float64)])
        coordinates[node] = functions[: counts[node]] @ monomials.T
    affine = [counts[node] for node in patches.node_of]
    origins = points[patches.order][patches.begins]
    matrices = {}
    for node, child in reversed(list(enumerate(patches.children))):
        if child != NONE:
            away = np.array([0.0, *(origins[child + 1] - origins[child])])
            second = coordinates[child + 1]
            stacked = np.vstack([coordinates[child], second + second[:, :1] * away])
            matrices[node] = two_scale_matrix(stacked, kept[node], share)
            coordinates[node] = matrices[node][: counts[node]] @ stacked
    return Space(patches, found, matrices, counts, build_subbands(patches, found, affine, counts))


def read_layout(model: Model, patches: Patches) -> tuple[list[int], dict[int, list[int]]]:
    """11.4: read how many affine functions each node or element has, and which of 1, x, y, z inner nodes keep."""
    contexts, counts, before = Contexts(model.layout), [0] * len(patches.children), 3
    for element, node in list(zip(patches.elements, patches.node_of, strict=True))[: patches.moving]:
        if model.has_affine:
            before = choose(4, partial(_ends_at, contexts, before))
            counts[node] = min(1 + before, len(element), model.functions)
    kept = {}
    for node, child in reversed(list(enumerate(patches.children))):
        if child != NONE:
            halves = counts[child], counts[child + 1]
            kept[node] = [0] if sum(halves) else []
            for c in (1, 2, 3):
                if len(kept[node]) < sum(halves) and contexts.bit("mask", c, halves.count(4)):
                    kept[node].append(c)
            counts[node] = len(kept[node])
    contexts.finish()
    return counts, kept


def _ends_at(contexts: Contexts, before: int, local: int) -> bool:
    """Read whether an element has no further local coordinates."""
    return not contexts.bit("local", before, local)


def two_scale_matrix(stacked: Floats, kept: list[int], share: float) -> Floats:
    """11.5: return J, given the coordinates of the affine functions of two halves."""
    functions = Functions(len(stacked), len(stacked))
    constant = stacked[:, 0]
    square = constant @ constant
    for c in kept:
        mean = stacked[:, c] @ constant / square if c > 0 and square > 0.0 else 0.0
        functions.add(stacked[:, c] - mean * constant)
    functions.complete(share)
    return functions.padded()


def build_subbands(patches: Patches, functions: list[Floats], affine: list[int], counts: list[int]) -> list[Subband]:
    """11.6: list the subbands."""
    subbands = [Subband(0, counts[0], 0, 0, 0)]
    depth, above = [0] * len(counts), [0] * len(counts)

    def append(size: int, depth: int, affine: int, above: int) -> None:
        subbands.append(Subband(subbands[-1].first + subbands[-1].size, size, depth, affine, above))

    for node, child in enumerate(patches.children):
        if child != NONE:
            append(counts[child] + counts[child + 1] - counts[node], depth[node] + 1, 0, above[node])
            for half in (child, child + 1):
                depth[half], above[half] = depth[node] + 1, len(subbands) - 1
    for own, count, node in zip(functions, affine, patches.node_of, strict=True):
        append(len(own) - count, -1, count, above[node])
    return subbands
