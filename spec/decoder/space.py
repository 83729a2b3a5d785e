"""Sections 23 and 24 of the specification: functions on patches, how they are joined, and the order of columns."""

from __future__ import annotations

import math
from dataclasses import dataclass

from spec.decoder.patches import PATCH, Patches
from spec.decoder.shape import Vector, arc_length_parameters, dot, series_functions

DEPENDENT = 2.0**-8
COVERED = 2.0**-10
ONCE_IS_ENOUGH = 0.125
SWEEPS = 6
LARGEST_DEGREE = 10

Matrix = list[Vector]


@dataclass
class Run:
    """Columns that are coded together: 24.3."""

    first: int
    size: int
    depth: int
    """-1 for a patch."""
    affine: int
    """Affine functions of the patch, which stand elsewhere."""
    above: int


@dataclass
class Space:
    """Functions of each patch, affine ones first, and the matrix and number of affine functions of each set."""

    patches: Patches
    functions: list[Matrix]
    affine: list[int]
    joints: list[Matrix]
    counts: list[int]
    runs: list[Run]

    @property
    def columns(self) -> int:
        return self.runs[-1].first + self.runs[-1].size

    def expand(self, coefficients: Vector) -> Vector:
        """24.4: values by place from one column of coefficients."""
        children, counts = self.patches.children, self.counts
        scaling: list[Vector] = [[] for _ in children]
        scaling[0] = coefficients[: counts[0]]
        runs = iter(self.runs[1:])
        for number, child in enumerate(children):
            if child < 0:
                continue
            run = next(runs)
            own = scaling[number] + coefficients[run.first : run.first + run.size]
            joint = self.joints[number]
            both = [dot([row[i] for row in joint], own) for i in range(len(own))]
            scaling[child], scaling[child + 1] = both[: counts[child]], both[counts[child] :]
        values: Vector = []
        for number, (functions, run) in enumerate(zip(self.functions, runs, strict=True)):
            own = scaling[self.patches.set_of[number]] + coefficients[run.first : run.first + run.size]
            values += [dot([function[i] for function in functions], own) for i in range(len(functions[0]))]
        return values


def exponents() -> list[tuple[int, int, int]]:
    """23.3: exponents of the polynomials, in order."""
    affine = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    every = [(a, b, c) for a in range(11) for b in range(11) for c in range(6) if a + b + 2 * c <= LARGEST_DEGREE]
    rest = [item for item in every if item not in affine]
    return affine + sorted(rest, key=lambda item: (item[0] + item[1] + 2 * item[2], -item[0], -item[1]))


EXPONENTS = exponents()


def add(functions: Matrix, column: Vector, threshold: float) -> bool:
    """23.1: orthonormalise one more column; False where nothing is left of it."""
    before = after = dot(column, column)
    for _ in range(2):
        weights = [dot(function, column) for function in functions]
        for function, weight in zip(functions, weights, strict=True):
            column = [value - other * weight for value, other in zip(column, function, strict=True)]
        after = dot(column, column)
        if after > ONCE_IS_ENOUGH * before:
            break
    norm = math.sqrt(after)
    if not norm > threshold * math.sqrt(before):
        return False
    functions.append([value / norm for value in column])
    return True


def complete(functions: Matrix, size: int, most: int) -> None:
    """Unit vectors until there are `most` functions."""
    for j in range(size):
        if len(functions) == most:
            return
        add(functions, [float(i == j) for i in range(size)], COVERED)


def local_coordinates(levels: list[list[int]]) -> Matrix:
    """23.2: three coordinates of each vertex, axis by axis."""
    local = []
    for axis in range(3):
        away = [float(level[axis] - levels[0][axis]) for level in levels]
        total = 0.0
        for value in away:
            total += value
        mean = total / len(levels)
        local.append([value - mean for value in away])
    largest = max(abs(value) for row in local for value in row)
    scale = 1.0 / largest if largest > 0.0 else 1.0
    local = [[value * scale for value in row] for row in local]
    axes = principal_axes([[dot(one, other) for other in local] for one in local])
    return [[(a * x + b * y) + c * z for x, y, z in zip(*local, strict=True)] for a, b, c in axes]


def principal_axes(m: Matrix) -> Matrix:
    """23.2, steps 4 and 5: rows, the widest axis first."""
    axes = [[float(i == j) for j in range(3)] for i in range(3)]
    for _ in range(SWEEPS):
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if m[p][q] == 0.0:
                continue
            theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q])
            t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + math.sqrt(theta * theta + 1.0))
            c = 1.0 / math.sqrt(t * t + 1.0)
            s = t * c
            for row in m:
                row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]
            for each in (m, axes):
                pairs = list(zip(each[p], each[q], strict=True))
                each[p] = [c * a - s * b for a, b in pairs]
                each[q] = [s * a + c * b for a, b in pairs]
    widths = [m[i][i] for i in range(3)]
    for j in (0, 1, 0):
        if widths[j] < widths[j + 1]:
            widths[j], widths[j + 1] = widths[j + 1], widths[j]
            axes[j], axes[j + 1] = axes[j + 1], axes[j]
    return axes


def add_polynomials(functions: Matrix, levels: list[list[int]], most: int) -> int:
    """23.3, basis patch: polynomials until there are `most` functions; how many are affine."""
    local = local_coordinates(levels)
    added: dict[tuple[int, int, int], Vector] = {}
    for a, b, c in EXPONENTS:
        if len(functions) == most:
            break
        less = [(a - 1, b, c), (a, b - 1, c), (a, b, c - 1)]
        axes = [axis for axis, power in enumerate((a, b, c)) if power > 0]
        if any(less[axis] not in added for axis in axes):
            continue
        column = [1.0] * len(levels)
        if axes:
            column = [value * x for value, x in zip(added[less[axes[0]]], local[axes[0]], strict=True)]
        if add(functions, column, DEPENDENT):
            added[a, b, c] = functions[-1]
    return sum(item in added for item in EXPONENTS[:4])


def add_columns(functions: Matrix, columns: Matrix, most: int) -> int:
    """Given columns until there are `most` functions; how many are affine."""
    affine = 0
    for j, column in enumerate(columns):
        if len(functions) == most:
            break
        if add(functions, column, DEPENDENT) and j < 4:
            affine += 1
    return affine


def columns_of_piece(levels: list[list[int]]) -> Matrix:
    """23.3, basis curve."""
    local = [[float(level[axis] - levels[0][axis]) for axis in range(3)] for level in levels]
    series = [series_functions(u, 0.0, 8) for u in arc_length_parameters(local)]
    return [
        [1.0] * len(local),
        *([p[axis] for p in local] for axis in range(3)),
        *([v[j] for v in series] for j in range(8)),
    ]


def build_space(kind: int, patches: Patches, levels: list[list[int]], most: int) -> Space:
    """Functions of all patches and sets."""
    found, affine = [], []
    counts = [0] * len(patches.children)
    coordinates: list[Matrix] = [[] for _ in counts]
    for number, patch in enumerate(patches.patches):
        own = [levels[vertex] for vertex in patch]
        functions: Matrix = []
        wanted = min(most, len(patch))
        if kind == PATCH:
            affine.append(add_polynomials(functions, own, wanted))
        else:
            affine.append(add_columns(functions, columns_of_piece(own), wanted))
        complete(functions, len(patch), wanted)
        found.append(functions)
        monomials = [[1.0] * len(own), *([float(level[axis] - levels[0][axis]) for level in own] for axis in range(3))]
        counts[patches.set_of[number]] = affine[-1]
        coordinates[patches.set_of[number]] = [[dot(f, m) for m in monomials] for f in functions[: affine[-1]]]
    joints = build_joints(patches.children, counts, coordinates)
    return Space(patches, found, affine, joints, counts, build_runs(patches, found, affine, counts))


def build_joints(children: list[int], counts: list[int], coordinates: list[Matrix]) -> list[Matrix]:
    """24.2: the matrix of each set that is not a patch; fills in `counts` and `coordinates`."""
    joints: list[Matrix] = [[] for _ in children]
    for number in reversed(range(len(children))):
        child = children[number]
        if child < 0:
            continue
        stacked = coordinates[child] + coordinates[child + 1]
        constant = [row[0] for row in stacked]
        functions: Matrix = []
        for c in range(4):
            column = [row[c] for row in stacked]
            mean = dot(column, constant) / dot(constant, constant) if c > 0 else 0.0
            add(functions, [value - mean * one for value, one in zip(column, constant, strict=True)], DEPENDENT)
        counts[number] = len(functions)
        coordinates[number] = [[dot(f, [row[c] for row in stacked]) for c in range(4)] for f in functions]
        complete(functions, len(stacked), len(stacked))
        joints[number] = functions
    return joints


def build_runs(patches: Patches, functions: list[Matrix], affine: list[int], counts: list[int]) -> list[Run]:
    """24.3."""
    runs = [Run(0, counts[0], 0, 0, 0)]
    above = [0] * len(patches.children)
    depth = [0] * len(patches.children)

    def append(size: int, depth_of_run: int, affine_of_patch: int, run_above: int) -> None:
        runs.append(Run(runs[-1].first + runs[-1].size, size, depth_of_run, affine_of_patch, run_above))

    for number, child in enumerate(patches.children):
        if child >= 0:
            append(counts[child] + counts[child + 1] - counts[number], depth[number] + 1, 0, above[number])
            for half in (child, child + 1):
                depth[half], above[half] = depth[number] + 1, len(runs) - 1
    for patch, own in enumerate(functions):
        append(len(own) - affine[patch], -1, affine[patch], above[patches.set_of[patch]])
    return runs
