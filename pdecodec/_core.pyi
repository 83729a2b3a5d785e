"""Types of the native core (core/bindings/python): written by hand, and compared with the module by
tests/codec/test_core_types.py.
"""

import enum
from collections.abc import Sequence
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
Uint8Array = NDArray[np.uint8]
Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]
AttributeFields = tuple[str, int, int, NDArray[Any], Int32Array | None, Sequence[str]]
Float32Array = NDArray[np.float32]
Rows = NDArray[Any]  # float32 or float64
# Vertices; sizes and indices of faces, and of lines; shapes, sizes and indices of cells.
Part = tuple[int, Int32Array, Int32Array, Int32Array, Int32Array, NDArray[np.uint8], Int32Array, Int32Array]
State = tuple[Float64Array, Float64Array, Float64Array]
Scaling = tuple[float, float, float]

class CodedConnectivity(NamedTuple):
    """Sections CONN and ORDR; ORDR is empty if there is no order to restore."""

    conn: bytes
    ordr: bytes

class CodedOrder(NamedTuple):
    """The source's numbers of vertices, faces and corners, in the order in which they are coded."""

    vertices: Int32Array
    faces: Int32Array
    corners: Int32Array

class CodedReference(NamedTuple):
    """Section REST after its header, and the predictor that makes the section smallest."""

    predictor: int
    data: bytes

class Smoothing(NamedTuple):
    """Weights by class, (7, 2); the first vertex at each vertex's position, or empty; smoothed grid coordinates
    [1/64 steps]; mean error of the smoothed frame divided by that of the frame before smoothing.
    """

    weights: Int32Array
    points: Int32Array
    grid: Int64Array
    error_ratio: float

class Curves(NamedTuple):
    """The vertices of all curves, curve after curve, and the index at which each curve begins."""

    order: Int32Array
    starts: Int64Array

def encode_description(times: NDArray[np.float64], names: Sequence[str]) -> bytes:
    """Return the coded stream of section SEQN: listed times [s], and names of objects."""

def encode_connectivity(parts: Sequence[Part], keep_order: bool) -> CodedConnectivity: ...
def encode_cells(parts: Sequence[Part]) -> bytes:
    """Return section SOLD."""

def inner_sides(parts: Sequence[Part]) -> tuple[Int32Array, Int32Array]:
    """Return sizes and indices of the sides that solids of one object share."""

def coded_orders(parts: Sequence[Part]) -> list[CodedOrder | None]:
    """Return the coded order of each part; None for a part coded as polygons, which keep their order."""

def extract_curves(parts: Sequence[Part], reference: Int64Array) -> Curves: ...
def encode_reference(
    starts: Int64Array,
    vertex: Int32Array,
    faces: int,
    grid: Int64Array,
    weights: Int32Array | None,
    points: Int32Array,
    ties: Int32Array,
) -> CodedReference:
    """Return section REST. weights, points: how the frame is smoothed; None and empty if it is not smoothed.
    ties: empty if no vertices are tied.
    """

def smooth_reference(
    starts: Int64Array,
    vertex: Int32Array,
    faces: int,
    grid: Int64Array,
    wanted: NDArray[np.float64],
    ties: Int32Array,
) -> Smoothing | None:
    """Return the smoothing of a frame; None if it would hardly bring the frame nearer to the wanted coordinates
    [steps], (vertices, 3).
    """

def decode_reference(
    starts: Int64Array, vertex: Int32Array, faces: int, vertices: int, predictor: int, data: bytes
) -> tuple[Int64Array, Int32Array]:
    """Return grid coordinates, (vertices, 3), in 1/64 steps if the predictor smooths; and ties, empty if no
    vertices are tied.
    """

def encode_attributes(
    parts: Sequence[Part],
    attributes: Sequence[Sequence[AttributeFields]],
    grid: Int64Array,
    uv_tolerance: float | None,
    keeps_rows: bool,
) -> bytes:
    """Return section ATTR."""

def fan_numbers(vertices: Int32Array, keys: Int32Array) -> Int32Array:
    """Return for each corner the number of its key among the keys of its vertex, in order of first occurrence."""

class PredictedFunctions(NamedTuple):
    """Quantised numbers, (functions, frames, axes), and the values that they decode to, (frames, axes, functions)."""

    quantised: Int64Array
    decoded: Float64Array

def quantise_predicted(wanted: Float64Array, rounding: float, step: float) -> PredictedFunctions:
    """Quantise values [steps], (functions, frames, axes), by prediction."""

def quantise_straight(wanted: Float64Array, tolerance: float) -> Int64Array:
    """Quantise values [steps], (functions, frames, axes), as changes of speed [1/16 step per frame]."""

def time_function_values(method: int, quantised: Int64Array, step: float) -> Float64Array:
    """Return the values, (frames, axes, functions), of quantised numbers, (functions, frames, axes)."""

def encode_time_functions(method: int, quantised: Int64Array) -> bytes:
    """Return a chunk of section TIME; empty if all numbers are zero."""

def measure_time_functions(quantised: Int64Array) -> float:
    """Return the number of bits that `encode_time_functions` would take."""

def cosine_wave(frames: int) -> Float64Array:
    """Return cos(2 pi j / (4 frames)), (4 frames,)."""

def encode_coefficients(
    coefficients: Int64Array, starts: Int64Array, kinds: Int64Array, parents: Int64Array, axes: int
) -> bytes:
    """Return a chunk of section COEF for (functions, channels) quantised coefficients; empty if all are zero."""

def measure_coefficients(
    coefficients: Int64Array,
    starts: Int64Array,
    kinds: Int64Array,
    parents: Int64Array,
    axes: int,
    copies: Float64Array | None = None,
) -> float:
    """Return the number of bits that `encode_coefficients` would take with this many copies of each subband."""

class Residuals:
    """Residuals and raw vertices of consecutive frames. Places ascend within a frame. The arrays are read-only.

    Raises
    ------
    ValueError
        If places do not ascend, a residual is zero or beyond 2^40 steps, or arrays do not match.
    """

    def __init__(
        self,
        frame_starts: Int64Array,
        places: Int32Array,
        quantised: Int64Array,
        raw_frame_starts: Int64Array,
        raw_places: Int32Array,
        raw_positions: NDArray[np.float32],
    ) -> None: ...
    @property
    def frame_starts(self) -> Int64Array:
        """(frames + 1,): the residuals of frame f are numbers ``frame_starts[f]`` to ``frame_starts[f + 1] - 1``."""
    @property
    def places(self) -> Int32Array:
        """(residuals,)."""
    @property
    def quantised(self) -> Int64Array:
        """(residuals, 3), in steps."""
    @property
    def raw_frame_starts(self) -> Int64Array:
        """(frames + 1,)."""
    @property
    def raw_places(self) -> Int32Array:
        """(raw vertices,): no residual has the same place in the same frame."""
    @property
    def raw_positions(self) -> NDArray[np.float32]:
        """(raw vertices, 3) [scene units]."""
    @property
    def frames(self) -> int: ...
    @property
    def count(self) -> int:
        """Number of residuals and of raw vertices."""
    @property
    def nbytes(self) -> int: ...

class FieldChunk(NamedTuple):
    """Values of a field, int64 (frames, rows, components); their kinds, uint8, None if all are finite; and the
    step that they were encoded with.
    """

    values: Int64Array
    kinds: NDArray[np.uint8] | None
    step: int

class FieldRows:
    """The rows of a field in some objects, and which rows are neighbours. domain: 0 vertices, 1 faces, 2
    corners, 3 objects.
    """

    def __init__(self, domain: int, parts: Sequence[Part]) -> None: ...
    @property
    def count(self) -> int: ...
    def some(self, numbers: Int64Array) -> FieldRows:
        """Return the rows with the given ascending numbers, and the neighbours among them."""

def encode_field_chunk(
    rows: FieldRows, values: Int64Array, kinds: NDArray[np.uint8] | None, levels: int, step: int
) -> bytes:
    """Return a chunk of section FDAT for values (frames, rows, components). Decoded values differ by at most step // 2.
    Values that are not finite are reduced to their kind: 1 not a number, 2 infinity, 3 minus infinity.

    Raises
    ------
    ValueError
        If a value exceeds 2^36, or arrays do not match the rows.
    """

def encode_transformed_field_chunk(
    rows: FieldRows,
    values: Int64Array,
    functions: Int64Array,
    coefficients: Int64Array,
    digits: NDArray[np.uint8],
    levels: int,
    step: int,
) -> bytes:
    """Return a chunk with functions of time (frames, 1, functions) and coefficients (rows, components,
    functions); their difference from the values is coded as a remainder. digits: fractional digits of the
    coefficients, which are at most 2^digits in magnitude.
    """

def decode_field_chunk(rows: FieldRows, data: bytes, frames: int, components: int) -> FieldChunk:
    """Undo `encode_field_chunk`; CorruptFileError if the chunk is damaged."""

def reference_distances(residuals: Residuals) -> Int64Array:
    """Return, for each frame, how many frames before it lies the frame that predicts its residuals: (frames,)."""

def measure_residuals(
    residuals: Residuals, patches: Int64Array, is_predicted: bool, distances: Int64Array, copies: float = 1.0
) -> float:
    """Return the number of bits that `encode_residuals` would take for `copies` times as many residuals like these."""

def encode_residuals(residuals: Residuals, patches: Int64Array, is_predicted: bool, distances: Int64Array) -> bytes:
    """Return a chunk of section CORR."""

def predict(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    velocities: Float64Array,
    accelerations: Float64Array,
    substep: float,
    keep: float,
) -> None: ...

class Sheets:
    def __init__(self, inverse_masses: Float64Array, middle: int) -> None: ...
    def add_distances(
        self, pairs: Int32Array, lengths: Float64Array, multipliers: Float64Array, scaling: Scaling
    ) -> None: ...
    def add_chains(
        self, chains: Int32Array, lengths: Float64Array, multipliers: Float64Array, scaling: Scaling
    ) -> None: ...
    def add_bending(
        self, stencils: Int32Array, coefficients: Float64Array, multipliers: Float64Array, scaling: Scaling
    ) -> None: ...
    def solve(self, positions: Float64Array, previous: Float64Array, is_first: bool) -> None: ...
    def advance(
        self,
        positions: Float64Array,
        previous: Float64Array,
        velocities: Float64Array,
        accelerations: Float64Array,
        substep: float,
        keep: float,
        substeps: int,
        iterations: int,
        threads: int,
    ) -> None: ...
    def store(self) -> None: ...

def solve_volumes(
    state: State, tetrahedra: Int32Array, volumes: Float64Array, multipliers: Float64Array, scaling: Scaling
) -> None: ...
def solve_tetrahedra(
    state: State,
    tetrahedra: Int32Array,
    inverse_rest: Float64Array,
    volumes: Float64Array,
    multipliers: Float64Array,
    shear: float,
    bulk: float,
    damping: float,
    substep: float,
) -> None: ...
def project_tetrahedra(state: State, tetrahedra: Int32Array, inverse_rest: Float64Array, stiffness: float) -> None: ...
def add_wind(
    positions: Float64Array, past: Float64Array, triangles: Int32Array, pressure: float, forces: Float64Array
) -> None: ...

class ObjFault(enum.Enum):
    NONE = ...
    BAD_INDEX = ...
    ZERO_INDEX = ...
    INDEX_OUTSIDE = ...
    TEXTURE_OUTSIDE = ...
    TOO_FEW_CORNERS = ...
    BAD_COORDINATES = ...

class ObjScan:
    def __init__(self, text: bytes) -> None: ...
    @property
    def fault(self) -> ObjFault: ...
    @property
    def fault_byte(self) -> int: ...
    @property
    def vertex_count(self) -> int: ...
    @property
    def texture_count(self) -> int: ...
    @property
    def texture_size(self) -> int: ...
    @property
    def positions(self) -> Float32Array: ...
    @property
    def vertex_extras(self) -> Float32Array: ...
    @property
    def textures(self) -> Float32Array: ...
    @property
    def normals(self) -> Float32Array: ...
    @property
    def vertex_sizes(self) -> Int32Array: ...
    @property
    def is_face(self) -> NDArray[np.uint8]: ...
    @property
    def element_sizes(self) -> Int32Array: ...
    @property
    def corners(self) -> Int32Array: ...
    @property
    def others(self) -> Int64Array: ...
    @property
    def unread(self) -> Int64Array: ...

class ObjStructure:
    def __init__(self, text: bytes) -> None: ...
    def read_positions(self, text: bytes, positions: Float32Array) -> tuple[Int64Array, int] | None: ...

def corner_normals(
    points: Float32Array,
    face_sizes: Int32Array,
    vertices: Int32Array,
    rows: Int32Array,
    normals: Float32Array,
    threads: int,
) -> None: ...
def write_rows(rows: Float32Array, word: str) -> bytes | None: ...
def encode_bands(values: Int64Array) -> bytes: ...
def decode_bands(data: bytes, bands: int, numbers: int) -> Int64Array: ...
def parallelograms(values: Int64Array, starts: Int64Array, corners: Int64Array, undo: bool) -> Int64Array: ...

class Patches:
    """Patches, or pieces of curves, and the partition tree that halves the mesh down to them.

    Attributes
    ----------
    order : (points,) int32
        Vertices of the mesh, patch after patch, without those that are tied to others.
    starts : (patches + 1,) int64
        Patch p holds ``order[starts[p]:starts[p + 1]]``.
    begins : (nodes,) int64
        Where in `order` each node of the tree begins; node 0 is the whole mesh.
    children : (nodes,) int64
        The first half of each node, which the second half follows; -1 for a patch.
    node_of : (patches,) int64
        The node of the tree that each patch is.
    """

    @property
    def order(self) -> Int32Array: ...
    @property
    def starts(self) -> Int64Array: ...
    @property
    def begins(self) -> Int64Array: ...
    @property
    def children(self) -> Int64Array: ...
    @property
    def node_of(self) -> Int64Array: ...

def early_patches(objects: Sequence[Part], points: int, still: Uint8Array) -> Patches | None: ...
def build_patches(
    objects: Sequence[Part], grid: Int64Array, points: int, ties: Int32Array, still: Uint8Array, early: Patches | None
) -> Patches: ...
def cut_curves(order: Int32Array, starts: Int64Array, points: int, ties: Int32Array, still: Uint8Array) -> Patches: ...
def encode_still(still: Uint8Array, first_vertices: Int64Array) -> bytes:
    """Return which vertices stand still, coded for section MODL."""

class Subbands(NamedTuple):
    """Functions of space that are coded together (core/sections/spatial/space_layout.hpp)."""

    starts: Int64Array
    kinds: Int64Array
    parents: Int64Array

class SpaceBasis:
    def __init__(
        self,
        kind: int,
        points: int,
        functions: int,
        threshold: int,
        rate: float,
        affine: bool,
        patches: Patches,
        grid: Int64Array,
        layout: bytes | None,
        threads: int,
    ) -> None: ...
    @property
    def functions(self) -> int: ...
    @property
    def coefficient_starts(self) -> Int64Array: ...
    @property
    def nearest(self) -> float: ...
    def subbands(self) -> Subbands: ...
    def encode_layout(self) -> bytes: ...
    def make_functions(self, threads: int) -> None: ...
    def functions_of(self, element: int) -> Float64Array: ...
    def project(self, values: FloatArray, threads: int) -> Rows:
        """Return coefficients in the precision of the values."""

    def project_some(self, values: FloatArray, subbands: Int64Array, threads: int) -> Rows:
        """Return the coefficients of some subbands."""

class Motion:
    """The displacements of the vertices in a group of frames; of all vertices, or of the vertices of some
    elements (core/decode/evaluate/motion.hpp).
    """

    def __init__(
        self,
        basis: SpaceBasis,
        quantised: Int64Array,
        axes: int,
        step: float,
        single: bool,
        subbands: Int64Array | None,
        threads: int,
    ) -> None: ...

def take_displacements(
    points: NDArray[np.float32], shape: Float64Array, farthest: float, rows: FloatArray, threads: int
) -> float:
    """Write (vertices, 3 frames): points (frames, vertices, 3) minus a shape. Return the largest magnitude."""

class SparseCoefficients(NamedTuple):
    """Quantised coefficients [steps], and the largest magnitude in each channel."""

    coefficients: Int64Array
    largest: Int64Array

def quantise_sparsely(
    values: FloatArray, axes: int, step: float, round_up_at: float, round_up_alone_at: float, threads: int
) -> SparseCoefficients: ...
def give_back_memory() -> None: ...
def product(left: Float64Array, right: Float64Array, threads: int) -> Float64Array: ...
def multiply_rows(rows: FloatArray, factors: Float64Array, axes: int, threads: int) -> Rows:
    """Return rows (rows, n axes), C-contiguous, times factors (n, k) on each axis, (rows, k axes), in their
    precision.
    """

def sums_of_squares(rows: FloatArray, single: bool, threads: int) -> Float64Array:
    """Return rows^T rows, (n, n), for rows (rows, n), C-contiguous, added up in float32 or float64, block by block."""

def sums_of_products(rows: FloatArray, others: FloatArray, threads: int) -> Float64Array:
    """Return rows^T others, (n, k), for rows (rows, n) and others (rows, k), both C-contiguous and of one
    precision, in which they are added up block by block.
    """

def sum_of_products(a: Float64Array, b: Float64Array) -> float: ...

class Eigen(NamedTuple):
    """Eigenvalues, decreasing, and eigenvectors, one per row; no rows if they were not requested."""

    values: Float64Array
    vectors: Float64Array

class OrthonormalColumns(NamedTuple):
    """QR decomposition of a matrix (rows, n), rows >= n: the transpose of Q, (n, rows), and R, (n, n)."""

    vectors: Float64Array
    triangle: Float64Array

def symmetric_eigen(matrix: Float64Array, with_vectors: bool, threads: int) -> Eigen: ...
def orthonormal_columns(matrix: Float64Array) -> OrthonormalColumns: ...
def binary_logarithms(values: Float64Array) -> Float64Array:
    """Return logarithms to base 2 of (rows, n) finite numbers of at least 2^-1022, with the same bits on every
    machine.
    """

class Excess:
    """The part of each vertex's error that exceeds a target."""

    def __init__(self) -> None: ...
    def __len__(self) -> int: ...
    def add_to(self, values: FloatArray, functions: Float64Array, axes: int, push: float) -> None:
        """Add `push` times the excess to the values of functions of time at the vertices."""

def farthest_apart(one: Motion, other: Motion, time: Float64Array, reference: Float64Array, threads: int) -> float:
    """Return the largest difference in a coordinate between two motions of the same vertices, before residuals."""

class MissedVertices(NamedTuple):
    """Residuals of the vertices that may miss the bound. If errors were requested, also the largest squared
    distance and the sum of squared distances of decoded positions.
    """

    residuals: Residuals
    largest_square: float
    sum_of_squares: float

class GroupModel:
    """A model of a group, compared with the positions that it approximates; residuals correct vertices beyond
    the bound.
    """

    def __init__(
        self,
        motion: Motion,
        time: Float64Array,
        reference: Float64Array,
        points: NDArray[np.float32],
        order: Int32Array,
        bound: float,
        step: float,
    ) -> None: ...
    def missing(
        self,
        margins: Float64Array,
        aim: tuple[float, float] | None,
        excess: Excess | None,
        has_errors: bool,
        threads: int,
    ) -> MissedVertices:
        """Fills `excess` if an aim is given."""

def series_functions(points: Float64Array, rate: float, order: int) -> Float64Array: ...
def arc_length_parameters(grid: Int64Array, pieces: Patches) -> Float64Array: ...
def writable_view(array: object) -> Float32Array: ...

class Run(NamedTuple):
    """Consecutive frames of one connectivity; `vertices` is -1 in a file with a single run."""

    first: int
    frames: int
    vertices: int

class Section(NamedTuple):
    """The type of a section, and the position of its bytes in the file."""

    type: str
    offset: int
    length: int

class Group(NamedTuple):
    """A group of frames; its kinds of functions and basis are given as numbers."""

    first: int
    frames: int
    functions: int
    basis: int
    step: float
    alpha: float

class GroupRange(NamedTuple):
    """First and end index of some groups."""

    first: int
    end: int

class Model(NamedTuple):
    """Section MODL."""

    kind: int
    points: int
    functions: int
    threshold: int
    rate: float
    is_affine: bool
    residual_step: float
    layout: bytes

class MeshCells(NamedTuple):
    """Faces, lines and cells of one object; the arrays are read-only."""

    face_counts: Int32Array
    face_indices: Int32Array
    line_counts: Int32Array
    line_indices: Int32Array
    cell_shapes: NDArray[np.uint8]
    cell_counts: Int32Array
    cell_indices: Int32Array

class DecodedAttribute(NamedTuple):
    """An attribute of an object; `domain` is its number. The arrays are read-only."""

    name: str
    domain: int
    values: NDArray[Any]
    indices: Int32Array | None
    labels: tuple[str, ...]

class Reference(NamedTuple):
    """The reference frame: grid coordinates, origin and step; whether it is smoothed; ties, empty if there are none."""

    grid: Int64Array
    origin: tuple[float, float, float]
    step: float
    is_smoothed: bool
    ties: Int32Array

class FieldGroup(NamedTuple):
    """Consecutive frames of a field, and their chunk (core/decode/stored_fields.hpp)."""

    first: int
    frames: int
    skipped: int
    in_chunk: int
    code: int
    unit: float
    offset: int
    size: int
    checksum: int
    source: int
    component: int

class StoredField(NamedTuple):
    """A header of section FLDS."""

    name: str
    domain: int
    type: int
    components: int
    unit: str
    objects: list[int]
    smallest: float
    largest: float
    bound: float
    groups: list[FieldGroup]

class Corrections(NamedTuple):
    """Frame, vertex and offset of each correction of a group."""

    frames: Int64Array
    vertices: Int32Array
    offsets: Float32Array

class Animation:
    """An open file (core/decode/animation.hpp). `file` is its bytes, or a binary file that is read on request,
    through its descriptor (not on Windows) or its methods. In a file of several runs each run is opened
    separately; before that, methods that need a run raise an error.
    """

    def __init__(self, file: bytes | int | BinaryIO, max_memory: int, threads: int, kept_bytes: int) -> None: ...
    @property
    def times(self) -> Float64Array: ...
    @property
    def jumps(self) -> list[int]:
        """Frames before which the motion is discontinuous."""
    @property
    def fps(self) -> float: ...
    @property
    def runs(self) -> list[Run]: ...
    def run_sections(self, run: int) -> list[Section]: ...
    def open_run(self, run: int) -> Animation: ...
    @property
    def vertex_counts(self) -> list[int]: ...
    @property
    def sections(self) -> list[Section]: ...
    @property
    def file_bytes(self) -> int: ...
    @property
    def groups(self) -> list[Group]: ...
    @property
    def model(self) -> Model: ...
    @property
    def still_vertices(self) -> Uint8Array: ...
    def names(self) -> list[str]: ...
    def connectivity(self) -> list[MeshCells]: ...
    def attributes(self) -> list[list[DecodedAttribute]]: ...
    def reference(self) -> Reference: ...
    @property
    def ties_vertices(self) -> bool: ...
    def remarks(self) -> bytes: ...
    def coefficients(self, group: int) -> Float64Array: ...
    def evaluate(self, quantity: int, times: Float64Array, object: int | None, out: Float32Array) -> None: ...
    def groups_at(self, quantity: int, time: float) -> GroupRange:
        """Return the groups that contribute to a quantity at a time."""
    def weights(self, quantity: int, time: float, group: int) -> Float64Array:
        """(time axes, functions)."""
    def fields(self, group: int) -> Float32Array:
        """(functions, vertices, axes)."""
    def corrections(self, group: int) -> Corrections: ...
    def stored_fields(self) -> list[StoredField]: ...
    def read_field(self, field: int, first: int, frames: int, out: NDArray[np.uint8]) -> None: ...
    def evaluate_field(
        self, field: int, times: Float64Array, derivative: int, object: int | None, out: NDArray[np.uint8]
    ) -> None: ...
    def check_field_group(self, field: int, group: int, deep: bool) -> None: ...
    def close(self) -> None: ...
    def verify(self) -> None: ...
    def check_section(self, type: str) -> None:
        """Check the bytes of a section of the run, or of the whole file if it has several runs."""
    def check_group(self, group: int) -> None:
        """Check the bytes of a group of frames."""
    def cancel(self) -> None: ...
