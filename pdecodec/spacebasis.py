"""Space bases: orthonormal functions of the reference frame on patches, joined upwards over the whole mesh.

A mesh is divided into elements: patches, by halving its graph again and again (space basis "patch"), or pieces of its
curves ("curve"). On each element stand orthonormal functions: the affine four ``1, x, y, z`` first (what the literal
Eq. 23 amounts to once its matrices are data), then polynomials of local coordinates by total degree, or the eight
functions of Eqs. 14 and 16 along a piece, then unit vectors until the space of the element is complete or it has as
many functions as it may.

What the affine functions of two neighbouring elements have in common, they share: those of a node of the partition tree
are an orthogonal combination of those of its halves, and only the node's wavelets (the rest of the combinations) stay
with it. A limb that moves as one needs four numbers, however many patches it has. (Alpert 1993, "A class of bases in L2
for the sparse representation of integral operators": multiwavelets, here on the vertices of a mesh.)

How many functions there are, and of what kind, follows from integers and from what the file says. The values of the
functions are floating-point numbers, and may be computed in any way: see `SpaceForm.threshold`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import SPACE_FUNCTIONS, series_functions
from pdecodec.curves import extract_curves
from pdecodec.errors import CorruptFileError
from pdecodec.patches import Patches, build_patches
from pdecodec.sequence import MeshObject
from pdecodec.shares import in_shares

if TYPE_CHECKING:
    from pdecodec.kernels.patch_functions import Elements

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

SpaceKind = Literal["patch", "curve"]

SPACE_KINDS: tuple[SpaceKind, ...] = ("patch", "curve")
"""By their number in the file."""

MOST_POINTS = {"patch": 256, "curve": 65535}
"""Vertices of a patch at most; about as many of a piece of a curve."""

MOST_FUNCTIONS = 128
"""Functions of an element at most: building them costs the square of their number."""

NORMAL_DEGREE = 2
"""What a factor of the third principal coordinate counts in a polynomial's degree: across a surface there is less
to describe than along it."""

LARGEST_DEGREE = 10
"""Of the polynomials; what comes after them is left to unit vectors."""

SHARES = (2.0**-12, 2.0**-40, 2.0**-12)
"""A polynomial, a function along a piece, a unit vector is dropped where no more than this share of its squared norm is
new. That of unit vectors is below 1 / points, so that they always complete the space of an element; those along a piece
are kept as long as they are more than rounding."""

THRESHOLDS = 8
"""Thresholds that an encoder has to choose from: each is SHARES less k sixteenths."""

MOST_MASK_BYTES = 5
"""Of a node's mask: three bits of the least probability there is."""

CLEAR = 2.0**-18
"""No share may be nearer to its threshold than this, relative to it: whoever computes it otherwise drops the same."""


@dataclass(frozen=True)
class SpaceForm:
    """What a file says of its space basis.

    Attributes
    ----------
    kind : {"patch", "curve"}
    points : int
        Vertices of a patch at most, or about as many of a piece.
    functions : int
        Of an element at most.
    threshold : int
        Which of THRESHOLDS: one that no column of the file comes near, so that all decoders drop the same columns
        however they round.
    rate : float
        r of Eqs. 14 and 16 over half a piece.
    affine : bool
        Whether pieces have the affine four, and unit vectors to complete them; patches always do.
    """

    kind: SpaceKind
    points: int
    functions: int
    threshold: int = 0
    rate: float = 0.0
    affine: bool = True


@lru_cache
def polynomial_exponents() -> Int64Array:
    """(n, 3) int64: exponents of the polynomials in order; the affine four, then by degree.

    The third coordinate counts twice, but for the affine four. Equal degrees: higher powers of the first
    coordinate first, then of the second.
    """
    found = [
        (a, b, c)
        for a in range(LARGEST_DEGREE + 1)
        for b in range(LARGEST_DEGREE + 1 - a)
        for c in range((LARGEST_DEGREE - a - b) // NORMAL_DEGREE + 1)
    ]
    affine = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    rest = [item for item in found if item not in affine]
    rest.sort(key=lambda item: (item[0] + item[1] + NORMAL_DEGREE * item[2], -item[0], -item[1]))
    return np.array(affine + rest, np.int64)


@lru_cache
def polynomial_table() -> Int64Array:
    """(n, 4) int64: how each polynomial is made of those before it.

    In the columns of the axes, which polynomial has a degree less on that axis, -1 for none; then along which axis it
    is made of that one, the first that it can be, -1 for the constant.
    """
    exponents = [tuple(row) for row in polynomial_exponents().tolist()]
    place = {item: j for j, item in enumerate(exponents)}
    table = np.full((len(exponents), 4), -1, np.int64)
    for j, item in enumerate(exponents):
        for axis in reversed(range(3)):
            if item[axis]:
                table[j, axis] = place[tuple(degree - (k == axis) for k, degree in enumerate(item))]
                table[j, 3] = axis
    return table


@dataclass(frozen=True, eq=False)
class SpaceBasis:
    """Elements, their functions, and how they are joined.

    Attributes
    ----------
    form : SpaceForm
    patches : Patches
        The elements, and the partition tree.
    elements : Elements
        The same with their functions, as compiled code takes them.
    counts : (nodes,) int64
        Affine functions of each node.
    masks : (nodes,) int64
        Which of 1, x, y, z a node keeps that is no element: bits 0 to 3.
    matrices : (nodes, 8, 8) float64
        Two-scale matrices, orthogonal: a node's affine functions and wavelets from its halves' affine functions.
    wavelet_starts : (nodes,) int64
        Where each node's wavelets begin among the functions; the whole's affine functions are the first.
    nearest : float
        The least relative distance of a share from its threshold, in the two-scale matrices.
    """

    form: SpaceForm
    patches: Patches
    elements: Elements
    counts: Int64Array
    masks: Int64Array
    matrices: Float64Array
    wavelet_starts: Int64Array
    nearest: float

    @property
    def order(self) -> NDArray[np.int32]:
        """(vertices,) int32: vertices of the mesh, element after element."""
        return self.patches.order

    @property
    def starts(self) -> Int64Array:
        """(elements + 1,) int64: element e holds ``order[starts[e]:starts[e + 1]]``."""
        return self.patches.starts

    @property
    def functions(self) -> int:
        """Functions of all elements together."""
        return int(self.elements.coefficient_starts[-1])

    @property
    def element_count(self) -> int:
        return self.starts.size - 1

    @property
    def subband_count(self) -> int:
        """One of the whole's affine functions, one for the wavelets of each node, one for each element's functions."""
        return 1 + self.counts.size

    @cached_property
    def largest(self) -> int:
        """Vertices of the largest element."""
        return int(np.diff(self.starts).max(initial=0))

    @cached_property
    def subbands(self) -> tuple[Int64Array, Int64Array, Int64Array]:
        """Functions as they are coded together: ``(starts, kinds, parents)``.

        Subband 0 is the whole's affine functions, then come the wavelets of each node, then each element's other
        functions. ``kinds`` is a node's depth (0 for subband 0), or -1 - affine for an element; ``parents`` the subband
        of the node above.
        """
        children = self.patches.children
        inner = np.flatnonzero(children >= 0)
        depth, above, subband = (np.zeros(children.size, np.int64) for _ in range(3))
        subband[inner] = 1 + np.arange(inner.size)
        for s in inner:
            for half in (children[s], children[s] + 1):
                depth[half], above[half] = depth[s] + 1, subband[s]
        starts = np.concatenate([[0], self.wavelet_starts[inner], self.elements.coefficient_starts])
        kinds = np.concatenate([[0], depth[inner] + 1, -1 - self.elements.affine])
        parents = np.concatenate([[0], above[inner], above[self.patches.node_of]])
        return starts.astype(np.int64), kinds.astype(np.int64), parents.astype(np.int64)

    @cached_property
    def _complete(self) -> tuple[Float64Array, Int64Array, float]:
        """All functions of each element: ``(basis, basis_starts, nearest)``, function after function."""
        from pdecodec.kernels.patch_functions import build_elements, new_scratch

        elements = self.elements
        ranks = elements.affine + np.diff(elements.coefficient_starts)
        basis_starts = np.concatenate([[0], np.cumsum(ranks * np.diff(self.starts))])
        basis = np.empty(int(basis_starts[-1]))
        distances = [self.nearest]

        def build(first: int, end: int) -> None:
            scratch = new_scratch(self.largest, self.form.functions, len(elements.polynomials))
            build_elements(first, end, elements, basis, basis_starts, scratch)
            distances.append(float(scratch.nearest[0]))

        in_shares(build, self.element_count)
        return basis, basis_starts, min(distances)

    @property
    def functions_made(self) -> tuple[Float64Array, Int64Array]:
        """All functions of each element, as an encoder has made them; none in a decoder, which makes those it needs."""
        made: tuple[Float64Array, Int64Array] = self.__dict__.get("_complete", (np.zeros(0), np.zeros(0, np.int64)))
        return made[:2]

    def functions_of_elements(self) -> Iterator[Float64Array]:
        """Of each element, its functions: (functions, points) float64."""
        basis, starts, _ = self._complete
        for begin, end, points in zip(starts[:-1], starts[1:], np.diff(self.starts), strict=True):
            yield basis[begin:end].reshape(-1, points)

    @property
    def is_clear(self) -> bool:
        """Whether every decoder drops the same columns, however it rounds."""
        return self._complete[2] > CLEAR

    def project(self, values: Float64Array) -> Float64Array:
        """Coefficients of values on vertices: (vertices, channels), mesh order, to (functions, channels) float64."""
        from pdecodec.kernels.partition_tree import analyse
        from pdecodec.kernels.space_transform import project_elements

        channels = values.shape[1]
        affine = np.zeros((self.counts.size, 4, channels))
        coefficients = np.zeros((self.functions, channels))
        ordered = np.ascontiguousarray(values[self.order], dtype=np.float64)
        basis, basis_starts, _ = self._complete

        def project(first: int, end: int) -> None:
            project_elements(first, end, ordered, self.elements, basis, basis_starts, affine, coefficients)

        in_shares(project, self.element_count)
        analyse(self.patches.children, self.counts, self.matrices, self.wavelet_starts, affine, coefficients)
        return coefficients

    def encode_masks(self) -> bytes:
        """Which of 1, x, y, z the nodes keep, as a decoder needs it: a coded stream."""
        from pdecodec.kernels.rangecoder import ENCODE, finish, new_coder

        coder, data = new_coder(ENCODE), np.zeros(MOST_MASK_BYTES * self.counts.size + 8, np.uint8)
        _code_masks(coder, data, self.patches.children, self.counts.copy(), self.masks.copy())
        return data[: finish(coder, data)].tobytes()


def build_space_basis(
    kind: SpaceKind,
    objects: Sequence[MeshObject],
    rest: Int64Array,
    *,
    points: int,
    functions: int,
    rate: float = 0.0,
    affine: bool = True,
) -> SpaceBasis:
    """A space basis for an encoder: one that all decoders build alike.

    Parameters
    ----------
    kind : {"patch", "curve"}
    objects : sequence of MeshObject
    rest : (vertices, 3) int64
        Grid coordinates of the reference frame.
    points, functions : int
        Of an element at most.
    rate : float
        r of Eqs. 14 and 16 over half a piece.
    affine : bool
        False leaves the functions of Eqs. 14 and 16 alone.
    """
    form = SpaceForm(kind, points, functions, rate=rate, affine=affine)
    patches, given = _elements(form, objects, rest, None)
    for threshold in range(THRESHOLDS):
        basis = _with_functions(replace(form, threshold=threshold), patches, given, rest, None)
        if basis.is_clear:
            break
    return basis


def decode_space_basis(
    form: SpaceForm, masks: bytes, objects: Sequence[MeshObject], rest: Int64Array, early: Patches | None = None
) -> SpaceBasis:
    """The space basis of a file.

    Parameters
    ----------
    form : SpaceForm
    masks : bytes
        What :meth:`SpaceBasis.encode_masks` gave.
    objects : sequence of MeshObject
    rest : (vertices, 3) int64
        Grid coordinates of the reference frame.
    early : Patches, optional
        What `pdecodec.patches.early_patches` gave; made again where the reference frame changes them.

    Raises
    ------
    CorruptFileError
        If the masks do not end where the partition tree does.
    """
    patches, given = _elements(form, objects, rest, early)
    return _with_functions(form, patches, given, rest, masks)


def _elements(
    form: SpaceForm, objects: Sequence[MeshObject], rest: Int64Array, early: Patches | None
) -> tuple[Patches, Float64Array]:
    """Elements, and the columns along pieces before orthonormalisation."""
    if form.kind == "patch":
        return build_patches(objects, rest, form.points, early), np.zeros((0, 0))
    curves = extract_curves(objects, rest)
    lengths = curves.lengths
    pieces = np.where(lengths <= form.points, 1, (2 * lengths + form.points) // (2 * form.points))
    number = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    starts = np.repeat(curves.starts[:-1], pieces) + number * np.repeat(lengths, pieces) // np.repeat(pieces, pieces)
    starts = np.append(starts, curves.starts[-1])
    given = series_functions(arc_length_parameter(rest[curves.order], starts), form.rate, SPACE_FUNCTIONS)
    begins, children, node_of = _chain(starts.size - 1)
    return Patches(curves.order, starts, starts[begins], children, node_of), given


def _chain(count: int) -> tuple[Int64Array, Int64Array, Int64Array]:
    """Nodes over elements in a row, halved again and again: ``(begins, children, node_of)``."""
    begins, ends, children = [0], [count], []
    for s in itertools.count():
        if s == len(begins):
            break
        if ends[s] - begins[s] == 1:
            children.append(-1)
            continue
        children.append(len(begins))
        middle = (begins[s] + ends[s]) // 2
        begins += [begins[s], middle]
        ends += [middle, ends[s]]
    leaves = np.flatnonzero(np.array(children) < 0)
    node_of = leaves[np.argsort(np.array(begins)[leaves])]
    return np.array(begins), np.array(children, np.int64), node_of


def _with_functions(
    form: SpaceForm, patches: Patches, given: Float64Array, rest: Int64Array, coded: bytes | None
) -> SpaceBasis:
    """Count the functions, and build the two-scale matrices; without coded masks they are chosen."""
    from pdecodec.kernels.partition_tree import build_two_scale, describe_elements
    from pdecodec.kernels.patch_functions import AFFINE, UNIT_VECTOR, Elements, new_scratch

    children, node_of, sizes = patches.children, patches.node_of, np.diff(patches.starts)
    table, shares = polynomial_table(), np.array(SHARES) * (1.0 - form.threshold / 16.0)
    affine, described = np.zeros(sizes.size, np.int64), np.zeros((sizes.size, AFFINE, AFFINE))
    elements = Elements(
        rest, patches.order, patches.starts, affine, np.zeros(sizes.size + 1, np.int64), node_of, table, given, shares,
        form.affine,
    )  # fmt: skip
    scratch = new_scratch(int(sizes.max(initial=0)), AFFINE, len(table))
    describe_elements(elements, form.functions if form.affine else 0, affine, described, scratch)
    counts, masks = np.zeros((2, children.size), np.int64)
    coordinates = np.zeros((children.size, AFFINE, AFFINE))
    counts[node_of], coordinates[node_of] = affine, described
    if coded is not None:
        _decode_masks(coded, children, counts, masks)
    matrices = np.zeros((children.size, 2 * AFFINE, 2 * AFFINE))
    scratch = new_scratch(2 * AFFINE, 2 * AFFINE, 0)
    build_two_scale(
        children, counts, masks, coded is None, shares[UNIT_VECTOR], rest[patches.order[patches.begins]], coordinates,
        matrices, np.empty((2 * AFFINE, AFFINE)), scratch,
    )  # fmt: skip
    inner = np.flatnonzero(children >= 0)
    wavelets = np.zeros(children.size, np.int64)
    wavelets[inner] = counts[children[inner]] + counts[children[inner] + 1] - counts[inner]
    wavelet_starts = counts[0] + np.cumsum(wavelets) - wavelets
    # Unit vectors complete whatever polynomials leave open.
    most = form.functions if form.affine else min(form.functions, given.shape[1])
    elements.coefficient_starts[:] = counts[0] + wavelets.sum()
    elements.coefficient_starts[1:] += np.cumsum(np.minimum(sizes, most) - affine)
    return SpaceBasis(
        form, patches, elements, counts, masks, matrices, wavelet_starts.astype(np.int64), float(scratch.nearest[0])
    )


def _decode_masks(coded: bytes, children: Int64Array, counts: Int64Array, masks: Int64Array) -> None:
    from pdecodec.kernels.rangecoder import is_finished, new_decoder

    data = np.frombuffer(bytearray(coded), np.uint8)
    coder = new_decoder(data)
    _code_masks(coder, data, children, counts, masks)
    if not is_finished(coder, data):
        raise CorruptFileError("section MODL does not end where its partition tree does; get the file again")


def _code_masks(
    coder: Int64Array, data: NDArray[np.uint8], children: Int64Array, counts: Int64Array, masks: Int64Array
) -> None:
    from pdecodec.kernels.partition_tree import MASK_CELLS, code_masks
    from pdecodec.kernels.rangecoder import EVEN

    code_masks(coder, data, np.full(MASK_CELLS, EVEN, np.int64), children, counts, masks)


def arc_length_parameter(along: Int64Array, starts: Int64Array) -> Float64Array:
    """Parameter u in [-1, 1] along each piece, by arc length of the reference frame.

    By index where all points of a piece coincide; 0 for a piece of one point.

    Parameters
    ----------
    along : (vertices, 3) int64
        Reference frame in quantisation steps, piece after piece.
    starts : (pieces + 1,) int64

    Returns
    -------
    (vertices,) float64
    """
    sizes, firsts = np.diff(starts), starts[:-1]
    steps = np.zeros(len(along))
    steps[1:] = np.sqrt((np.diff(along, axis=0).astype(np.float64) ** 2).sum(axis=1))
    steps[firsts] = 0.0
    still = np.add.reduceat(steps, firsts) == 0.0
    steps[np.repeat(still, sizes)] = 1.0
    steps[firsts] = 0.0
    running = np.cumsum(steps)
    lengths = np.maximum(running[starts[1:] - 1] - running[firsts], 1e-300)
    share = (running - np.repeat(running[firsts], sizes)) / np.repeat(lengths, sizes)
    return np.where(np.repeat(sizes == 1, sizes), 0.0, 2.0 * share - 1.0)
