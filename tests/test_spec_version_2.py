"""Format version 2: the independent decoder gives the library's positions, the specification its numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from sequence_cases import rich_sequence
from test_round_trip import CLIPS
from test_spec_decoder import assert_same

from pdecodec import (
    ArraySequence,
    Connectivity,
    EncodeSettings,
    MeshObject,
    MeshSequence,
    encode,
    groupanimation,
    groupchoice,
    groupencoder,
    groupmodel,
    groups,
    open_animation,
    spacebasis,
    spline,
)
from pdecodec.kernels import (
    border,
    face_order,
    level_model,
    memory,
    numbers,
    patch_functions,
    polygons,
    rangecoder,
    surface,
    vertex_order,
)
from pdecodec.levelcoding import FIRST_WEIGHT
from pdecodec.spacebasis import SpaceKind
from spec.decoder import animation as independent
from spec.decoder import rangecoder as independent_coder
from spec.decoder.space import EXPONENTS

SPECIFICATION = Path(__file__).resolve().parent.parent / "spec" / "pdeanim.md"


def assert_decodes_alike(sequence: MeshSequence, path: Path) -> None:
    encode(sequence, path, EncodeSettings(profile="auto", effort=1))
    other = independent.decode_file(path)
    with open_animation(path) as mine:
        first, last = mine.times[0], mine.times[-1]
        times = [*mine.times, *(first + (last - first) * np.array([-0.5, 0.03, 0.51, 0.97, 1.5]))]
        assert_same(other, mine, times)


@pytest.mark.parametrize("name", ["points", "lines", "smooth", "noise", "one frame", "three frames", "teleporting"])
def test_it_decodes_version_2_to_the_same_bits(name: str, tmp_path: Path) -> None:
    assert_decodes_alike(CLIPS[name](), tmp_path / "a.pdeanim")


def bending_strips() -> ArraySequence:
    """Two strips of quads apart from each other, one of them bending, and a vertex of no face."""
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(5), np.arange(14), indexing="ij"))
    frame = np.arange(9.0)[:, None]
    strip = np.stack(np.broadcast_arrays(column + 0.0 * frame, row, np.sin(0.3 * row * column + 0.8 * frame)), axis=-1)
    still = strip[:1].repeat(9, axis=0) + np.array([9.0, 0.0, 0.5])
    points = np.concatenate([strip, still, np.ones((9, 1, 3))], axis=1)
    corner = (14 * np.arange(4)[:, None] + np.arange(13)).ravel()
    quads = np.stack([corner, corner + 1, corner + 15, corner + 14], axis=1)
    indices = np.concatenate([quads, quads + 70]).ravel()
    connectivity = Connectivity(141, face_counts=np.full(104, 4), face_indices=indices)
    return ArraySequence(points, objects=[MeshObject("strips", connectivity)])


@pytest.mark.parametrize(("kind", "points"), [("patch", 16), ("patch", 64), ("curve", 16), ("curve", 64)])
def test_many_patches_and_pieces_decode_to_the_same_bits(
    kind: SpaceKind, points: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(groupchoice, "SPACES", ((kind, points),))
    path = tmp_path / "a.pdeanim"
    assert_decodes_alike(bending_strips(), path)
    with open_animation(path) as animation:
        assert animation.info()["space_basis"] == kind
        assert animation.info()["patches"] >= 3


def test_groups_decode_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(groupencoder, "LONGEST_GROUP", 4)
    path = tmp_path / "a.pdeanim"
    assert_decodes_alike(bending_strips(), path)
    with open_animation(path) as animation:
        assert animation.info()["groups"] == 3


def test_attributes_and_objects_come_back_alike(tmp_path: Path) -> None:
    assert_decodes_alike(rich_sequence(), tmp_path / "a.pdeanim")


def test_a_surface_comes_back_in_the_order_it_had(tmp_path: Path) -> None:
    strips = bending_strips()
    random = np.random.default_rng(1)
    name = random.permutation(strips.vertex_count)
    indices = name[strips.connectivity.face_indices.reshape(-1, 4)][random.permutation(strips.connectivity.face_count)]
    mesh = Connectivity(name.size, face_counts=np.full(len(indices), 4), face_indices=indices.ravel())
    path = tmp_path / "a.pdeanim"
    points = strips.read_frames(0, strips.frame_count)[:, np.argsort(name)]
    assert_decodes_alike(ArraySequence(points, objects=[MeshObject("strips", mesh)]), path)
    with open_animation(path) as animation:
        assert animation.connectivity.same_as(mesh)
        assert animation.sections["CONN"] < 40 < 100 < animation.sections["ORDR"]


def test_its_tables_of_logarithms_are_the_librarys() -> None:
    assert independent_coder.EVEN == rangecoder.EVEN
    assert rangecoder.SQUASH.tolist() == independent_coder.SQUASH
    assert rangecoder.STRETCH.tolist() == independent_coder.STRETCH


def test_its_polynomials_come_in_the_librarys_order() -> None:
    assert [tuple(row) for row in spacebasis.polynomial_exponents().tolist()] == EXPONENTS


def test_the_numbers_of_version_2_are_the_librarys() -> None:
    text = " ".join(SPECIFICATION.read_text("utf-8").split())
    ends = ", ".join(map(str, level_model.ZONE_ENDS[:-1]))
    for said in (
        f"One row of {groups.GROUP_ENTRY.size} bytes for each group",
        f"| number of frames f | 1 to {groups.MAX_GROUP_FRAMES} |",
        f"| points of a patch at most | 1 to {spacebasis.MOST_POINTS} |",
        f"| functions of a patch at most | 1 to {spacebasis.MOST_FUNCTIONS} |",
        f"a + b + {spacebasis.NORMAL_DEGREE} c <= {spacebasis.LARGEST_DEGREE}",
        f"if after > {patch_functions.ONCE_IS_ENOUGH} * before: stop",
        f"with the threshold 2^{np.log2(patch_functions.DEPENDENT):.0f}",
        f"with the threshold 2^{np.log2(patch_functions.COVERED):.0f}",
        f"of the ends {ends} that are not above",
        f"while m <= {level_model.UNARY} and a mixed bit",
        f"while d < {level_model.LARGEST_DIGITS} and a bit",
        f"All weights of 25 are {round(FIRST_WEIGHT * 65536)} at first",
        f"n = min(n + 1, {rangecoder.SLOWEST})",
        f"number(kind), 0 to 2^{numbers.MOST_DIGITS} - 2",
        f"where i <= {numbers.MODELLED_DIGITS}",
        f"Weights are {memory.EQUAL_WEIGHT} at first where two cells are asked",
        f"z = ({memory.HASH_FACTOR} z + x_(c-b)) mod 2^32",
        f"where there is L and r >= {memory.LONGEST_RUN}, else 1",
        f"for b = 1 to {memory.LONG_CONTEXT}: z",
        f"if b = {memory.SHORT_CONTEXT}: u = floor(z / 2^{32 - memory.TABLE_BITS})",
        f"exceed 2^{memory.PAST_SIZE.bit_length() - 1}",
        f"min(c - S, {memory.FARTHEST}), p",
        f"the history of {polygons.NEW_HISTORY_BITS} bits, `recent`",
        f"f = min(F, {surface.MOST_FACES}), a = min(floor(A / 2), {surface.MOST_ANGLE})",
        f"There are queues 0 to {border.PRIORITIES - 1}.",
        f"for size = 3 to {surface.LAST_TOLD_SIZE}",
        f"all three at most {surface.MOST_SIZE}",
        f"t = number(distance), at most {2 * surface.FARTHEST}",
        f"the first {face_order.MOST_SIDES} corners, from the first corner on",
        f"or the {face_order.MOST_LISTED}nd.",
        f"at most {face_order.MOST_SIDES - 1}, and the face is not named",
        f"min(|last - b|, {vertex_order.FARTHEST})",
        f"half = {spline.HALF_WINDOW} where the largest h is at most {spline.EVEN} times",
        f"{groupanimation.BYTES_PER_LEVEL} for each vertex and column of the widest group",
        f"| {groupanimation.BYTES_PER_MODE} for each frame and function of time",
    ):
        assert said in text, said


def test_modl_ends_where_the_specification_says() -> None:
    text = SPECIFICATION.read_text("utf-8")
    table = text[text.index("### 21.1") : text.index("### 21.2")]
    last = max(int(offset) for offset in re.findall(r"^\| (\d+) \|", table, re.MULTILINE))
    description = groupmodel.GroupModelDescription(
        space="patch", points=128, functions=128, correction_step=0.5, columns=7
    )
    assert len(description.to_bytes()) == last + 8
    assert description.to_bytes()[last] == 7
