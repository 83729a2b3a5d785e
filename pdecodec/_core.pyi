"""Types of the native core (core/bindings/python): written by hand, compared with the module by
tests/codec/test_core_types.py.
"""

import enum
from collections.abc import Sequence
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]
AttributeFields = tuple[str, int, int, NDArray[Any], Int32Array | None, Sequence[str]]
Float32Array = NDArray[np.float32]
Rows = NDArray[Any]  # of float32 or float64
Part = tuple[int, Int32Array, Int32Array, Int32Array, Int32Array]
State = tuple[Float64Array, Float64Array, Float64Array]
Scaling = tuple[float, float, float]

class CodedConnectivity(NamedTuple):
    """Sections CONN and ORDR; the latter is empty if there is no order to restore."""

    conn: bytes
    ordr: bytes

class CodedOrder(NamedTuple):
    """The source's number of each vertex, face and corner, in the order in which they are coded."""

    vertices: Int32Array
    faces: Int32Array
    corners: Int32Array

class CodedReference(NamedTuple):
    """Section REST behind its header, and the predictor that makes it smallest."""

    predictor: int
    data: bytes

class Smoothing(NamedTuple):
    """Weights by class, (7, 2); the point that each vertex lies on, or nothing; grid coordinates [1/64 steps]; mean
    error of the smoothed frame to that of the frame.
    """

    weights: Int32Array
    points: Int32Array
    grid: Int64Array
    error_ratio: float

class Curves(NamedTuple):
    """Vertices of all curves, and where in them each curve begins."""

    order: Int32Array
    starts: Int64Array

def encode_description(times: NDArray[np.float64], names: Sequence[str]) -> bytes:
    """Coded stream of section SEQN: listed times [s], and names of objects."""

def encode_connectivity(parts: Sequence[Part], keep_order: bool) -> CodedConnectivity: ...
def coded_orders(parts: Sequence[Part]) -> list[CodedOrder | None]:
    """Of each part; None where it is coded as polygons, which keep their order."""

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
    """`weights`, `points`: how the frame is smoothed, or None and nothing. `ties`: empty if no vertices are tied."""

def smooth_reference(
    starts: Int64Array,
    vertex: Int32Array,
    faces: int,
    grid: Int64Array,
    wanted: NDArray[np.float64],
    ties: Int32Array,
) -> Smoothing | None:
    """Nothing where the frame would hardly come nearer to the coordinates that are wanted [steps], (vertices, 3)."""

def decode_reference(
    starts: Int64Array, vertex: Int32Array, faces: int, vertices: int, predictor: int, data: bytes
) -> tuple[Int64Array, Int32Array]:
    """Grid coordinates, (vertices, 3), in 1/64 steps where the predictor smooths; and ties, empty without any."""

def encode_attributes(
    parts: Sequence[Part],
    attributes: Sequence[Sequence[AttributeFields]],
    grid: Int64Array,
    uv_tolerance: float | None,
    keeps_rows: bool,
) -> bytes:
    """Section ATTR."""

def fan_numbers(vertices: Int32Array, keys: Int32Array) -> Int32Array:
    """Of each corner, the number of its key among those of its vertex, as they come first."""

class PredictedFunctions(NamedTuple):
    """Numbers, (functions, frames, axes), and what they decode to, (frames, axes, functions)."""

    quantised: Int64Array
    decoded: Float64Array

def quantise_predicted(wanted: Float64Array, rounding: float, step: float) -> PredictedFunctions:
    """Of values in steps, (functions, frames, axes)."""

def quantise_straight(wanted: Float64Array, tolerance: float) -> Int64Array:
    """Of values in steps, (functions, frames, axes): changes of speed in sixteenths of a step a frame."""

def time_function_values(method: int, quantised: Int64Array, step: float) -> Float64Array:
    """(frames, axes, functions) of (functions, frames, axes)."""

def encode_time_functions(method: int, quantised: Int64Array) -> bytes:
    """A chunk of section TIME; empty where all numbers are zero."""

def measure_time_functions(quantised: Int64Array) -> float:
    """Bits that `encode_time_functions` would take."""

def cosine_wave(frames: int) -> Float64Array:
    """cos(2 pi j / (4 frames)), (4 frames,)."""

def encode_coefficients(
    coefficients: Int64Array, starts: Int64Array, kinds: Int64Array, parents: Int64Array, axes: int
) -> bytes:
    """A chunk of section COEF, of (functions, channels) quantised coefficients; empty where all are zero."""

def measure_coefficients(
    coefficients: Int64Array,
    starts: Int64Array,
    kinds: Int64Array,
    parents: Int64Array,
    axes: int,
    copies: Float64Array | None = None,
) -> float:
    """Bits that `encode_coefficients` would take with so many copies of each subband."""

class Residuals:
    """Residuals and raw vertices of consecutive frames. Places ascend within a frame; arrays cannot be written.

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
        """(frames + 1,): residuals of frame f are those from ``frame_starts[f]`` to ``frame_starts[f + 1] - 1``."""
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
        """(raw vertices,): none of them with a residual in the same frame."""
    @property
    def raw_positions(self) -> NDArray[np.float32]:
        """(raw vertices, 3) [scene units]."""
    @property
    def frames(self) -> int: ...
    @property
    def count(self) -> int:
        """Residuals and raw vertices."""
    @property
    def nbytes(self) -> int: ...

class FieldChunk(NamedTuple):
    """Values of a field, int64 (frames, rows, components); their kinds, uint8, None if all are numbers; and the step
    that they were encoded with.
    """

    values: Int64Array
    kinds: NDArray[np.uint8] | None
    step: int

class FieldRows:
    """Rows of a field, of all objects given, and which rows are neighbours. domain: 0 vertices, 1 faces, 2 corners,
    3 objects.
    """

    def __init__(self, domain: int, parts: Sequence[Part]) -> None: ...
    @property
    def count(self) -> int: ...
    def some(self, numbers: Int64Array) -> FieldRows:
        """Return some of the rows, given in ascending order, and which of them are neighbours."""

def encode_field_chunk(
    rows: FieldRows, values: Int64Array, kinds: NDArray[np.uint8] | None, levels: int, step: int
) -> bytes:
    """A chunk of section FDAT of values (frames, rows, components). Decoded values differ by at most step // 2; of
    values that are no numbers only the kind is kept: 1 not a number, 2 infinity, 3 minus infinity.

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
    """The same, from functions of time (frames, 1, functions) times coefficients (rows, components, functions) of so
    many digits behind the point, at most 2^digits in size; what they leave is coded as a remainder.
    """

def decode_field_chunk(rows: FieldRows, data: bytes, frames: int, components: int) -> FieldChunk:
    """Undo `encode_field_chunk`; CorruptFileError if the chunk is damaged."""

def reference_distances(residuals: Residuals) -> Int64Array:
    """(frames,): how many frames before each the one lies that its residuals are predicted from."""

def measure_residuals(
    residuals: Residuals, patches: Int64Array, is_predicted: bool, distances: Int64Array, copies: float = 1.0
) -> float:
    """Bits that `encode_residuals` would take of so many times as many residuals like these."""

def encode_residuals(residuals: Residuals, patches: Int64Array, is_predicted: bool, distances: Int64Array) -> bytes:
    """A chunk of section CORR."""

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
        Vertices of the mesh, patch after patch, but for those that are tied to others.
    starts : (patches + 1,) int64
        Patch p holds ``order[starts[p]:starts[p + 1]]``.
    begins : (nodes,) int64
        Where in `order` each node of the tree begins; node 0 is the whole.
    children : (nodes,) int64
        First of the two halves of each node, the second follows it; -1 for a patch.
    node_of : (patches,) int64
        The node that each patch is.
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

def early_patches(objects: Sequence[Part], points: int) -> Patches | None: ...
def build_patches(
    objects: Sequence[Part], grid: Int64Array, points: int, ties: Int32Array, early: Patches | None
) -> Patches: ...
def cut_curves(order: Int32Array, starts: Int64Array, points: int, ties: Int32Array) -> Patches: ...

class Subbands(NamedTuple):
    """Functions of space as they are coded together (core/sections/spatial/space_layout.hpp)."""

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
        """In the precision of the values."""

    def project_some(self, values: FloatArray, subbands: Int64Array, threads: int) -> Rows:
        """The same."""

class Motion:
    """What moves the vertices in a group of frames, or those of some elements (core/decode/evaluate/motion.hpp)."""

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
    """Write (vertices, 3 frames) of points (frames, vertices, 3) less a shape; the largest magnitude."""

class SparseCoefficients(NamedTuple):
    """Coefficients in steps, and the largest magnitude of each channel."""

    coefficients: Int64Array
    largest: Int64Array

def quantise_sparsely(
    values: FloatArray, axes: int, step: float, round_up_at: float, round_up_alone_at: float, threads: int
) -> SparseCoefficients: ...
def give_back_memory() -> None: ...
def product(left: Float64Array, right: Float64Array, threads: int) -> Float64Array: ...
def multiply_rows(rows: FloatArray, factors: Float64Array, axes: int, threads: int) -> Rows:
    """(rows, k axes) of rows (rows, n axes), C-contiguous, times factors (n, k) on each axis, in their precision."""

def sums_of_squares(rows: FloatArray, single: bool, threads: int) -> Float64Array:
    """(n, n) of rows (rows, n), C-contiguous, added up in float32 or float64, block by block."""

def sums_of_products(rows: FloatArray, others: FloatArray, threads: int) -> Float64Array:
    """(n, k) of rows (rows, n) and others (rows, k) of one precision, both C-contiguous, added up in it likewise."""

def sum_of_products(a: Float64Array, b: Float64Array) -> float: ...

class Eigen(NamedTuple):
    """Eigenvalues, falling, and eigenvectors, a row each; no rows without vectors."""

    values: Float64Array
    vectors: Float64Array

class OrthonormalColumns(NamedTuple):
    """Of a matrix (rows, n), rows >= n, the transposed Q (n, rows) and R (n, n) of its QR decomposition."""

    vectors: Float64Array
    triangle: Float64Array

def symmetric_eigen(matrix: Float64Array, with_vectors: bool, threads: int) -> Eigen: ...
def orthonormal_columns(matrix: Float64Array) -> OrthonormalColumns: ...
def binary_logarithms(values: Float64Array) -> Float64Array:
    """To base 2, of (rows, n) finite numbers that are not below 2^-1022; the same bits on every machine."""

class Excess:
    """By how much errors of vertices exceed their target."""

    def __init__(self) -> None: ...
    def __len__(self) -> int: ...
    def add_to(self, values: FloatArray, functions: Float64Array, axes: int, push: float) -> None:
        """Add it, `push` times, in functions of time to values on vertices."""

def farthest_apart(one: Motion, other: Motion, time: Float64Array, reference: Float64Array, threads: int) -> float:
    """How far two motions of the same vertices are apart at most, in a coordinate before residuals."""

class MissedVertices(NamedTuple):
    """Residuals of the vertices that may miss the bound; where errors are wanted, the largest and the sum of the
    squared distances as a decoder has them.
    """

    residuals: Residuals
    largest_square: float
    sum_of_squares: float

class GroupModel:
    """A motion held against the positions that it is to give; residuals are those of the bound."""

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
        """With an aim, `excess` is filled."""

def series_functions(points: Float64Array, rate: float, order: int) -> Float64Array: ...
def arc_length_parameters(grid: Int64Array, pieces: Patches) -> Float64Array: ...
def writable_view(array: object) -> Float32Array: ...

class Run(NamedTuple):
    """Consecutive frames of one connectivity; -1 vertices where the file is of one run."""

    first: int
    frames: int
    vertices: int

class Section(NamedTuple):
    """Type, and where its bytes are in the file."""

    type: str
    offset: int
    length: int

class Group(NamedTuple):
    """A group of frames, with its numbers of functions of time and of their basis."""

    first: int
    frames: int
    functions: int
    basis: int
    step: float
    alpha: float

class GroupRange(NamedTuple):
    """The first of some groups, and one behind the last."""

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

class FacesAndLines(NamedTuple):
    """Those of one object; arrays cannot be written."""

    face_counts: Int32Array
    face_indices: Int32Array
    line_counts: Int32Array
    line_indices: Int32Array

class DecodedAttribute(NamedTuple):
    """An attribute of an object, with the number of its domain; arrays cannot be written."""

    name: str
    domain: int
    values: NDArray[Any]
    indices: Int32Array | None
    labels: tuple[str, ...]

class Reference(NamedTuple):
    """The reference frame: grid coordinates, origin and step; whether it is smoothed; ties, empty without any."""

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
    """An open file (core/decode/animation.hpp); `file` is its bytes, or a binary file that is read when needed: by its
    descriptor (not on Windows), or as Python reads it. Of several runs each is opened by itself: what is not of all is
    an error else.
    """

    def __init__(self, file: bytes | int | BinaryIO, max_memory: int, threads: int, kept_bytes: int) -> None: ...
    @property
    def times(self) -> Float64Array: ...
    @property
    def jumps(self) -> list[int]:
        """Frames that motion jumps to from the frame before."""
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
    def names(self) -> list[str]: ...
    def connectivity(self) -> list[FacesAndLines]: ...
    def attributes(self) -> list[list[DecodedAttribute]]: ...
    def reference(self) -> Reference: ...
    @property
    def ties_vertices(self) -> bool: ...
    def remarks(self) -> bytes: ...
    def coefficients(self, group: int) -> Float64Array: ...
    def evaluate(self, quantity: int, times: Float64Array, object: int | None, out: Float32Array) -> None: ...
    def groups_at(self, quantity: int, time: float) -> GroupRange:
        """Those that count at a time."""
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
        """Check the bytes of a section, of a run or of a file of several."""
    def check_group(self, group: int) -> None:
        """Check the bytes of a group of frames."""
    def cancel(self) -> None: ...
