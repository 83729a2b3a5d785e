"""Section 11 of the specification: functions on elements, the partition tree, and the order of functions."""

from __future__ import annotations

import math
from dataclasses import dataclass

from spec.decoder.contexts import Contexts
from spec.decoder.patches import PATCH, Patches
from spec.decoder.shape import Vector, arc_length_parameters, dot, series_functions

SHARES = (2.0**-12, 2.0**-40, 2.0**-12)
POLYNOMIAL, ALONG_PIECE, UNIT_VECTOR = range(3)
ONCE_IS_ENOUGH = 0.125
SUM_BITS = 61
MOMENT_BITS = TURN_BITS = 30
SWEEPS = 8
FLOOR = 16
LARGEST_DEGREE = 10

Matrix = list[Vector]
Points = list[list[int]]


@dataclass
class SpaceForm:
    """What MODL says of the space basis: 10."""

    kind: int
    points: int
    functions: int
    threshold: int
    rate: float
    affine: bool


@dataclass
class Subband:
    """Functions that are coded together: 11.6."""

    first: int
    size: int
    depth: int
    """-1 for an element."""
    affine: int
    """Affine functions of the element, which stand elsewhere."""
    above: int


@dataclass
class Space:
    """Functions of each element, affine ones first, and the two-scale matrix and affine functions of each node."""

    patches: Patches
    functions: list[Matrix]
    matrices: list[Matrix]
    counts: list[int]
    subbands: list[Subband]

    def expand(self, coefficients: Vector) -> Vector:
        """11.7: values by place from one channel of coefficients."""
        children, counts = self.patches.children, self.counts
        affine: list[Vector] = [[] for _ in children]
        affine[0] = coefficients[: counts[0]]
        subbands = iter(self.subbands[1:])
        for number, child in enumerate(children):
            if child < 0:
                continue
            subband = next(subbands)
            own = affine[number] + coefficients[subband.first : subband.first + subband.size]
            both = [dot([row[i] for row in self.matrices[number]], own) for i in range(len(own))]
            affine[child], affine[child + 1] = both[: counts[child]], both[counts[child] :]
        values: Vector = []
        for number, (functions, subband) in enumerate(zip(self.functions, subbands, strict=True)):
            own = affine[self.patches.node_of[number]] + coefficients[subband.first : subband.first + subband.size]
            points = range(len(self.patches.patches[number]))
            values += [dot([function[i] for function in functions], own) for i in points]
        return values


def exponents() -> list[tuple[int, int, int]]:
    """11.3: exponents of the polynomials, in order."""
    affine = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    every = [(a, b, c) for a in range(11) for b in range(11) for c in range(6) if a + b + 2 * c <= LARGEST_DEGREE]
    rest = [item for item in every if item not in affine]
    return affine + sorted(rest, key=lambda item: (item[0] + item[1] + 2 * item[2], -item[0], -item[1]))


EXPONENTS = exponents()


def local_coordinates(grid: Points) -> Points:
    """11.1: coordinates of each point, axis by axis, of the axes that are more than rounding."""
    size = len(grid)
    local = []
    for axis in range(3):
        away = [point[axis] - grid[0][axis] for point in grid]
        local.append([size * value - sum(away) for value in away])
    shift = max(abs(value) for row in local for value in row).bit_length() - (SUM_BITS - size.bit_length()) // 2
    local = [[value >> shift if shift > 0 else value << -shift for value in row] for row in local]
    scale = max(sum(moment(row, row) for row in local).bit_length() - MOMENT_BITS, 0)
    for _ in range(SWEEPS):
        turned = [turn(local, scale, p, q) for p, q in ((0, 1), (0, 2), (1, 2))]
        if not any(turned):
            break
    for j in (0, 1, 0):
        if moment(local[j], local[j]) < moment(local[j + 1], local[j + 1]):
            local[j], local[j + 1] = local[j + 1], local[j]
    count = 0
    while count < 3 and moment(local[count], local[count]) >> scale >= 1024:
        count += 1
    return local[:count]


def moment(one: list[int], other: list[int]) -> int:
    """Sum of products."""
    return sum(a * b for a, b in zip(one, other, strict=True))


def turn(local: Points, scale: int, p: int, q: int) -> bool:
    """11.1, step 3: one rotation, unless the two axes are hardly correlated."""
    first, second = moment(local[p], local[p]), moment(local[q], local[q])
    mixed = moment(local[p], local[q])
    if (mixed >> scale) ** 2 <= ((first >> scale) + FLOOR) * ((second >> scale) + FLOOR) >> 8:
        return False
    across, along = (second - first) >> scale, (2 * mixed) >> scale
    root = math.isqrt(across * across + along * along)
    cosine = math.isqrt((2**TURN_BITS + (abs(across) << TURN_BITS) // root) << (TURN_BITS - 1))
    sine = ((along << (TURN_BITS - 1)) // root << TURN_BITS) // cosine
    if across < 0:
        sine = -sine
    pairs = list(zip(local[p], local[q], strict=True))
    local[p] = [(cosine * a - sine * b) >> TURN_BITS for a, b in pairs]
    local[q] = [(sine * a + cosine * b) >> TURN_BITS for a, b in pairs]
    return True


def add(functions: Matrix, column: Vector, share: float) -> bool:
    """11.3: orthonormalise one more column; False where no more than a share of it is new."""
    before = after = dot(column, column)
    for _ in range(2):
        weights = [dot(function, column) for function in functions]
        for function, weight in zip(functions, weights, strict=True):
            column = [value - other * weight for value, other in zip(column, function, strict=True)]
        after = dot(column, column)
        if after > ONCE_IS_ENOUGH * before:
            break
    if share > 0.0 and not after > share * before:
        return False
    scale = 1.0 / math.sqrt(after) if after > 0.0 else 0.0
    functions.append([value * scale for value in column])
    return True


def complete(functions: Matrix, size: int, most: int, share: float) -> None:
    """Unit vectors until there are `most` functions."""
    for j in range(size):
        if len(functions) == most:
            return
        add(functions, [float(i == j) for i in range(size)], share)


def add_affine(functions: Matrix, local: Points, size: int, count: int) -> None:
    """The constant and local coordinates."""
    for column in [[1] * size, *local][:count]:
        add(functions, [float(value) for value in column], 0.0)


def add_polynomials(functions: Matrix, local: Points, most: int, share: float) -> None:
    """11.3, basis patch: polynomials beyond the affine four until there are `most` functions."""
    added = dict(zip(EXPONENTS, functions[: 1 + len(local)], strict=False))
    for a, b, c in EXPONENTS[4:]:
        if len(functions) == most:
            break
        less = [(a - 1, b, c), (a, b - 1, c), (a, b, c - 1)]
        axes = [axis for axis, power in enumerate((a, b, c)) if power > 0]
        if any(less[axis] not in added for axis in axes):
            continue
        column = [value * x for value, x in zip(added[less[axes[0]]], map(float, local[axes[0]]), strict=True)]
        if add(functions, column, share):
            added[a, b, c] = functions[-1]


def columns_of_piece(grid: Points, rate: float) -> Matrix:
    """11.3, basis curve."""
    local = [[float(point[axis] - grid[0][axis]) for axis in range(3)] for point in grid]
    series = [series_functions(u, rate, 8) for u in arc_length_parameters(local)]
    return [[values[j] for values in series] for j in range(8)]


def build_space(form: SpaceForm, masks: bytes, patches: Patches, grid: Points) -> Space:
    """Functions of all elements and nodes."""
    shares = [share * (1.0 - form.threshold / 16.0) for share in SHARES]
    found, affine = [], []
    counts = [0] * len(patches.children)
    coordinates: list[Matrix] = [[] for _ in counts]
    for number, patch in enumerate(patches.patches):
        own = [grid[vertex] for vertex in patch]
        local, size = local_coordinates(own), len(own)
        functions: Matrix = []
        most = min(size, form.functions if form.affine else min(form.functions, 8))
        affine.append(min(1 + len(local), most) if form.affine else 0)
        add_affine(functions, local, size, affine[-1])
        if form.kind == PATCH:
            add_polynomials(functions, local, most, shares[POLYNOMIAL])
        else:
            for column in columns_of_piece(own, form.rate):
                if len(functions) < most:
                    add(functions, column, shares[ALONG_PIECE])
        if form.affine:
            complete(functions, size, most, shares[UNIT_VECTOR])
        functions += [[0.0] * size] * (most - len(functions))
        found.append(functions)
        monomials = [[1.0] * size, *([float(point[axis] - own[0][axis]) for point in own] for axis in range(3))]
        counts[patches.node_of[number]] = affine[-1]
        coordinates[patches.node_of[number]] = [[dot(f, m) for m in monomials] for f in functions[: affine[-1]]]
    kept = read_masks(masks, patches.children, counts)
    origins = [grid[patches.order[begin]] for begin in patches.begins]
    matrices = build_matrices(patches.children, counts, kept, origins, coordinates, shares[UNIT_VECTOR])
    return Space(patches, found, matrices, counts, build_subbands(patches, found, affine, counts))


def read_masks(data: bytes, children: list[int], counts: list[int]) -> list[list[int]]:
    """11.4: which of 1, x, y, z each node keeps; fills in `counts`."""
    contexts = Contexts(data)
    kept: list[list[int]] = [[] for _ in children]
    for number in reversed(range(len(children))):
        if (child := children[number]) < 0:
            continue
        halves = counts[child], counts[child + 1]
        kept[number] = [0] if sum(halves) else []
        for c in (1, 2, 3):
            if len(kept[number]) < sum(halves) and contexts.bit(c, halves.count(4)):
                kept[number].append(c)
        counts[number] = len(kept[number])
    contexts.finish()
    return kept


def build_matrices(
    children: list[int],
    counts: list[int],
    kept: list[list[int]],
    origins: Points,
    coordinates: list[Matrix],
    share: float,
) -> list[Matrix]:
    """11.5: the two-scale matrix of each node that is no element; fills in `coordinates`."""
    matrices: list[Matrix] = [[] for _ in children]
    for number in reversed(range(len(children))):
        if (child := children[number]) < 0:
            continue
        away = [0.0, *(float(b - a) for a, b in zip(origins[child], origins[child + 1], strict=True))]
        second = [[row[c] + away[c] * row[0] for c in range(4)] for row in coordinates[child + 1]]
        stacked = coordinates[child] + second
        constant = [row[0] for row in stacked]
        square = dot(constant, constant)
        functions: Matrix = []
        for c in kept[number]:
            column = [row[c] for row in stacked]
            mean = dot(column, constant) / square if c > 0 and square > 0.0 else 0.0
            add(functions, [value - mean * one for value, one in zip(column, constant, strict=True)], 0.0)
        coordinates[number] = [[dot(f, [row[c] for row in stacked]) for c in range(4)] for f in functions]
        complete(functions, len(stacked), len(stacked), share)
        functions += [[0.0] * len(stacked)] * (len(stacked) - len(functions))
        matrices[number] = functions
    return matrices


def build_subbands(patches: Patches, functions: list[Matrix], affine: list[int], counts: list[int]) -> list[Subband]:
    """11.6."""
    subbands = [Subband(0, counts[0], 0, 0, 0)]
    above = [0] * len(patches.children)
    depth = [0] * len(patches.children)

    def append(size: int, depth_of_node: int, affine_of_element: int, subband_above: int) -> None:
        first = subbands[-1].first + subbands[-1].size
        subbands.append(Subband(first, size, depth_of_node, affine_of_element, subband_above))

    for number, child in enumerate(patches.children):
        if child >= 0:
            append(counts[child] + counts[child + 1] - counts[number], depth[number] + 1, 0, above[number])
            for half in (child, child + 1):
                depth[half], above[half] = depth[number] + 1, len(subbands) - 1
    for patch, own in enumerate(functions):
        append(len(own) - affine[patch], -1, affine[patch], above[patches.node_of[patch]])
    return subbands
