"""Space bases: orthonormal functions of the reference frame on elements, joined upwards over the whole mesh.

A mesh is divided into elements: patches, by halving its graph again and again (space basis "patch"), or pieces of
its curves ("curve"). Each element has orthonormal functions. The four affine ones ``1, x, y, z`` come first (the
literal Eq. 23 has the same effect if its matrices are stored). Next come polynomials of local coordinates by total
degree, or the eight functions of Eqs. 14 and 16 along a piece. Unit vectors follow until the functions span the
whole element or the largest number of functions is reached.

The affine functions that two neighbouring elements have in common are stored once: those of a node of the partition
tree are an orthogonal combination of those of its halves, and only the remaining combinations (the node's wavelets)
are stored with the node. A limb that moves rigidly needs four numbers, however many patches it has. (Alpert 1993, "A
class of bases in L2 for the sparse representation of integral operators": multiwavelets, here on the vertices of a
mesh.)

The number and kind of functions follow from integers and from the file. The values of the functions are
floating-point numbers, and may be computed in any way: see `SpaceForm.threshold`. All of this is native:
`core/sections/spatial/`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.codec.sections.bytestream import FieldWriter
from pdecodec.codec.sections.elements import EarlyPatches, Patches, build_patches, extract_curves
from pdecodec.mesh.arrays import Float64Array, Int32Array, Int64Array, Uint8Array
from pdecodec.mesh.sequence import MeshObject
from pdecodec.mesh.still import NO_STILL
from pdecodec.mesh.ties import NO_TIES
from pdecodec.system.shares import thread_count

Rows = NDArray[Any]
"""Arrays of float32 or float64."""

SpaceKind = Literal["patch", "curve"]

SPACE_KINDS: tuple[SpaceKind, ...] = ("patch", "curve")
"""Kinds in the order of their numbers in the file."""

HAS_STILL = 2
"""Flag in the byte of the kind: some vertices stand still."""

MAX_POINTS = {"patch": 256, "curve": 65535}
"""Largest number of vertices of a patch, and largest approximate number of vertices of a piece of a curve."""

MAX_FUNCTIONS = 128
"""Largest number of functions of an element; building them takes time that grows with the square of their number."""

THRESHOLDS = 8
"""Number of thresholds that an encoder can choose from: threshold k is lower than the usual one by k sixteenths
of it.
"""

MIN_THRESHOLD_DISTANCE = 2.0**-18
"""Smallest relative distance between a column's new fraction and the threshold at which all decoders drop the
same columns.
"""


@dataclass(frozen=True)
class SpaceForm:
    """Parameters of a space basis that are stored in the file.

    Attributes
    ----------
    kind : {"patch", "curve"}
    points : int
        Largest number of vertices of a patch, or approximate number of a piece.
    functions : int
        Largest number of functions of an element.
    threshold : int
        Index of the threshold among THRESHOLDS, chosen so that no column of the file is near it: all decoders then drop
        the same columns, however they round.
    rate : float
        r of Eqs. 14 and 16 over half a piece.
    affine : bool
        Whether pieces have affine functions and unit vectors, as patches always do.
    """

    kind: SpaceKind
    points: int
    functions: int
    threshold: int = 0
    rate: float = 0.0
    affine: bool = True


class SpaceBasis:
    """Elements, their functions, and the tree that joins them.

    Parameters
    ----------
    form : SpaceForm
    patches : Patches
        The elements, and the partition tree.
    reference : (vertices, 3) int64
        Grid coordinates of the reference frame.
    layout : bytes, optional
        The number of local coordinates of each element, and which of 1, x, y, z the nodes of the partition tree keep,
        as in :attr:`layout`. Default: chosen.
    still : bytes
        Which vertices stand still, coded for section MODL; empty if all move.

    Raises
    ------
    CorruptFileError
        If the layout does not end where the partition tree does.

    Attributes
    ----------
    form : SpaceForm
    patches : Patches
    order : (points,) int32
        Vertices of the mesh, element after element, without vertices that are tied to others.
    vertices : int
        Number of vertices, tied ones included.
    starts : (elements + 1,) int64
        Element e holds ``order[starts[e]:starts[e + 1]]``.
    functions : int
        Number of functions of all elements together.
    coefficient_starts : (elements + 1,) int64
        Index of each element's first function that is not affine.
    """

    def __init__(
        self, form: SpaceForm, patches: Patches, reference: Int64Array, layout: bytes | None = None, still: bytes = b""
    ) -> None:
        self.form, self.patches, self.still = form, patches, still
        self.core = _core.SpaceBasis(
            SPACE_KINDS.index(form.kind), form.points, form.functions, form.threshold, form.rate, form.affine,
            patches, reference, layout, thread_count(),
        )  # fmt: skip
        self.order, self.starts, self.vertices = patches.order, patches.starts, len(reference)
        self.functions, self.coefficient_starts = self.core.functions, self.core.coefficient_starts

    @property
    def element_count(self) -> int:
        return self.starts.size - 1

    @cached_property
    def subbands(self) -> _core.Subbands:
        """Functions that are coded together.

        Subband 0 has the affine functions of the whole mesh. The wavelets of each node follow, then the other
        functions of each element. ``kinds`` is the depth of a node (0 for subband 0), or -1 - affine for an element;
        ``parents`` is the subband of the parent node.
        """
        return self.core.subbands()

    def functions_of_elements(self) -> Iterator[Float64Array]:
        """Yield the functions of each element, (functions, points) float64."""
        self.core.make_functions(thread_count())
        return map(self.core.functions_of, range(self.element_count))

    @property
    def nearest(self) -> float:
        """Smallest distance between a column's new fraction and its threshold, relative to the threshold."""
        self.core.make_functions(thread_count())
        return self.core.nearest

    @property
    def is_clear(self) -> bool:
        """Whether every decoder drops the same columns, however it rounds."""
        return self.nearest > MIN_THRESHOLD_DISTANCE

    def project(self, values: Rows) -> Rows:
        """Return the coefficients, (functions, channels), of values at vertices, (vertices, channels) in mesh order.

        Sums are computed in the precision of the values, except sums that elements share. The result has the
        precision of the values.
        """
        contiguous: Rows = np.ascontiguousarray(values)
        return self.core.project(contiguous, thread_count())

    def project_some(self, values: Rows, subbands: Int64Array) -> Rows:
        """Return the coefficients of the functions of some subbands only, one subband after another.

        Values are contiguous; subbands ascend, the first of them 0.
        """
        return self.core.project_some(values, subbands, thread_count())

    def subbands_of(self, elements: Int64Array, *, least_depth: int | None = None) -> Int64Array:
        """Return, ascending, the subbands of the whole mesh, of some elements and of the nodes above them; and
        of all nodes down to `least_depth`, if given.
        """
        _, kinds, parents = self.subbands
        nodes = kinds.size - self.element_count
        is_chosen = np.zeros(kinds.size, bool)
        is_chosen[:nodes] = least_depth is None or kinds[:nodes] <= least_depth
        above = nodes + elements
        while above.size:
            is_chosen[above] = True
            above = np.unique(parents[above[above > 0]])
        return np.flatnonzero(is_chosen)

    def functions_in(self, subbands: Int64Array) -> Int64Array:
        """Return the indices of the functions of some subbands, (n,) int64."""
        starts, sizes = self.subbands.starts[subbands], np.diff(self.subbands.starts)[subbands]
        ends = np.cumsum(sizes)
        return np.repeat(starts - (ends - sizes), sizes) + np.arange(int(sizes.sum()))

    @cached_property
    def layout(self) -> bytes:
        """The coded layout: number of local coordinates of each element, and which of 1, x, y, z the nodes keep."""
        return self.core.encode_layout()


def build_space_basis(
    kind: SpaceKind,
    objects: Sequence[MeshObject],
    reference: Int64Array,
    *,
    points: int,
    functions: int,
    rate: float = 0.0,
    affine: bool = True,
    ties: Int32Array = NO_TIES,
) -> SpaceBasis:
    """Build a space basis for an encoder, which all decoders build alike.

    Parameters
    ----------
    kind : {"patch", "curve"}
    objects : sequence of MeshObject
    reference : (vertices, 3) int64
        Grid coordinates of the reference frame.
    points, functions : int
        Largest numbers of an element.
    rate : float
        r of Eqs. 14 and 16 over half a piece.
    affine : bool
        False uses only the functions of Eqs. 14 and 16.
    ties : (vertices,) int32, optional
        As :attr:`pdecodec.codec.sections.reference.ReferenceFrame.ties`.
    """
    form = SpaceForm(kind, points, functions, rate=rate, affine=affine)
    return clear_space_basis(SpaceBasis(form, _elements(form, objects, reference, None, ties), reference), reference)


def clear_space_basis(basis: SpaceBasis, reference: Int64Array) -> SpaceBasis:
    """Return the space basis with a threshold, changed if needed, at which all decoders build it alike.

    Parameters
    ----------
    basis : SpaceBasis
        With threshold 0.
    reference : (vertices, 3) int64
        Grid coordinates from which it was made.
    """
    for threshold in range(1, THRESHOLDS):
        if basis.is_clear:
            break
        basis = SpaceBasis(replace(basis.form, threshold=threshold), basis.patches, reference, still=basis.still)
    return basis


def trial_space_basis(
    kind: SpaceKind,
    objects: Sequence[MeshObject],
    reference: Int64Array,
    *,
    points: int,
    functions: int,
    early: EarlyPatches | None = None,
    ties: Int32Array = NO_TIES,
    still: Uint8Array = NO_STILL,
) -> SpaceBasis:
    """Build a space basis for estimates only. If it is chosen, :func:`clear_space_basis` must check it, which
    computes the functions and is most of the work.
    """
    form = SpaceForm(kind, points, functions)
    patches = early.of(points) if early and kind == "patch" else None
    coded = _core.encode_still(still, np.cumsum([0, *(item.vertex_count for item in objects)])) if still.size else b""
    return SpaceBasis(form, _elements(form, objects, reference, patches, ties, still), reference, still=coded)


def decode_space_basis(
    form: SpaceForm,
    layout: bytes,
    objects: Sequence[MeshObject],
    reference: Int64Array,
    early: Patches | None = None,
    ties: Int32Array = NO_TIES,
    still: Uint8Array = NO_STILL,
) -> SpaceBasis:
    """Return the space basis of a file.

    Parameters
    ----------
    form : SpaceForm
    layout : bytes
        :attr:`SpaceBasis.layout`.
    objects : sequence of MeshObject
    reference : (vertices, 3) int64
        Grid coordinates of the reference frame.
    early : Patches, optional
        The result of `pdecodec.codec.sections.elements.early_patches`; remade if the reference frame changes them.
    ties, still : optional
        As those of :class:`pdecodec.codec.sections.reference.ReferenceFrame`.

    Raises
    ------
    CorruptFileError
        If the layout does not end where the partition tree does.
    """
    return SpaceBasis(form, _elements(form, objects, reference, early, ties, still), reference, layout)


def _elements(
    form: SpaceForm,
    objects: Sequence[MeshObject],
    reference: Int64Array,
    early: Patches | None,
    ties: Int32Array,
    still: Uint8Array = NO_STILL,
) -> Patches:
    if form.kind == "patch":
        return build_patches(objects, reference, form.points, early, ties, still)
    curves = extract_curves(objects, reference)
    return _core.cut_curves(curves.order, curves.starts, form.points, ties, still)


def arc_length_parameter(reference: Int64Array, pieces: Patches) -> Float64Array:
    """Return the parameter u in [-1, 1] along each piece, by arc length of the reference frame.

    By index if all points of a piece coincide; 0 for a piece of one point.

    Parameters
    ----------
    reference : (vertices, 3) int64
        Grid coordinates of the reference frame.
    pieces : Patches

    Returns
    -------
    (vertices,) float64
        Piece after piece.
    """
    return _core.arc_length_parameters(reference, pieces)


def encode_model(basis: SpaceBasis, residual_step: float) -> bytes:
    """Return section MODL: the parameters of the space basis, and the step of residuals [scene units]."""
    writer, form = FieldWriter(), basis.form
    writer.numbers("B", SPACE_KINDS.index(form.kind) | (HAS_STILL if basis.still else 0))
    writer.count(form.points)
    writer.numbers("BB", form.functions, form.threshold)
    if form.kind == "curve":
        writer.numbers("dB", form.rate, form.affine)
    writer.numbers("d", residual_step)
    if basis.still:
        writer.count(len(basis.still))
    return writer.to_bytes() + basis.still + basis.layout
