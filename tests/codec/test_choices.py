"""What profile "auto" chooses beside steps: shapes or trajectories, the rest shape's step, where motion starts from."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from pdecodec import _core
from pdecodec._core import Residuals
from pdecodec.codec.encode.displacements import ORIGINS, TIME_FUNCTIONS, Displacements, Origin, Sight, TimeFunctions
from pdecodec.codec.encode.effort import EFFORTS
from pdecodec.codec.encode.encoder import encode
from pdecodec.codec.encode.estimate import Estimate, bit_counter
from pdecodec.codec.encode.group_choice import GroupSearch
from pdecodec.codec.encode.group_fit import FittedGroup, GroupChoice, GroupFitter
from pdecodec.codec.encode.principal import principal_axes, principal_energies
from pdecodec.codec.encode.quantisation import columns_of, quantise_on, quantise_sparsely
from pdecodec.codec.encode.refinement import Refinement
from pdecodec.codec.encode.report import EncodeReport
from pdecodec.codec.opening import open_animation
from pdecodec.codec.sections.groups import GroupEntry, cosines, functions_of_time, group_functions
from pdecodec.codec.sections.reference import quantise_reference
from pdecodec.codec.sections.residuals import residual_step
from pdecodec.codec.sections.space_basis import MOST_FUNCTIONS, SpaceBasis, build_space_basis
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from pdecodec.simulate.scenes import build
from spec.sealing import take_apart
from tests.support.mesh_cases import connectivity_of, grid


def blend_shapes(frames: int = 60, rows: int = 12) -> ArraySequence:
    """A sheet of which three random shapes come and go one after the other: each its own curve in time."""
    random = np.random.default_rng(5)
    rest = np.stack([*np.meshgrid(np.arange(rows), np.arange(rows)), np.zeros((rows, rows))], axis=-1).reshape(-1, 3)
    shapes = random.normal(size=(3, rows * rows, 3))
    at = np.arange(frames)[:, None] - np.array([10, 30, 50])
    weights = np.exp(-0.02 * at * at)
    points = rest + np.einsum("fk,kvx->fvx", weights, shapes)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, rows))])


def turning_pieces(frames: int = 200) -> ArraySequence:
    """Twenty solid pieces of thirty vertices, each tumbling about three axes at speeds of its own."""
    random = np.random.default_rng(6)
    moved = random.normal(size=(1, 20, 30, 3))
    for x, y in ((0, 1), (1, 2), (2, 0)):
        angle = np.arange(frames)[:, None, None] * random.uniform(0.05, 0.3, (1, 20, 1))
        one, other = moved[..., x], moved[..., y]
        turned = np.broadcast_to(moved, (frames, 20, 30, 3)).copy()
        turned[..., x] = np.cos(angle) * one - np.sin(angle) * other
        turned[..., y] = np.sin(angle) * one + np.cos(angle) * other
        moved = turned
    points = random.uniform(size=(20, 1, 3)) * 50 + moved
    faces = [[30 * piece + k, 30 * piece + k + 1, 30 * piece + k + 2] for piece in range(20) for k in range(28)]
    mesh = MeshObject("pieces", connectivity_of(600, faces))
    return ArraySequence(points.reshape(frames, 600, 3).astype(np.float32), objects=[mesh])


def size(report: EncodeReport) -> int:
    return report.file_bytes


def reference_step(sequence: ArraySequence, bound: float, effort: EffortName = "default") -> float:
    """Quantisation step of the reference frame, over the bound."""
    data = encode(sequence, max_error=bound, effort=effort).data
    assert data is not None
    (reference,) = (part for part in take_apart(data) if part.kind == "REST")
    (step,) = struct.unpack("<d", reference.content[:8])
    return float(step) / bound


def test_blend_shapes_are_shapes_and_come_back_within_the_bound() -> None:
    sequence = blend_shapes()
    report = encode(sequence, tolerance=1e-3)
    assert report.summary.startswith("shapes x patch: 3 shapes carry 100 % of the motion")
    assert report.data is not None
    assert report.bound is not None
    with open_animation(report.data) as animation:
        everything = animation.read_frames(0, 60)
        assert np.linalg.norm(everything - sequence.read_frames(0, 60), axis=2).max() <= report.bound
        assert animation.info()["time_bases"] == ["shapes"]
        for frame in (59, 0, 31):
            assert np.array_equal(animation.read_frames(frame, frame + 1)[0], everything[frame])


def test_a_reference_frame_whose_parts_turn_is_made_finer() -> None:
    assert reference_step(turning_pieces(), 0.1) < 0.5


def test_a_reference_frame_that_only_bends_a_little_and_shortly_is_not_made_finer() -> None:
    assert reference_step(blend_shapes(6), 0.05) > 0.5


def keyed_shapes(frames: int = 40) -> ArraySequence:
    """A sheet that goes straight from shape to shape."""
    shapes = np.random.default_rng(8).normal(size=(4, 144, 3)) * 0.3
    at = np.linspace(0, 3, frames)
    weights = np.maximum(1.0 - np.abs(at[:, None] - np.arange(4)), 0.0)
    rest = blend_shapes(1).read_frames(0, 1)
    return ArraySequence(rest + np.einsum("fk,kvx->fvx", weights, shapes), objects=list(blend_shapes(1).objects))


@pytest.mark.parametrize("make", [blend_shapes, keyed_shapes, turning_pieces])
def test_a_looser_bound_never_takes_more_bytes(make: Callable[[], ArraySequence]) -> None:
    sequence = make()
    sizes = [size(encode(sequence, tolerance=tolerance)) for tolerance in np.geomspace(1e-1, 1e-3, 9)]
    assert sizes == sorted(sizes)


def test_what_nodes_keep_counts_where_the_motion_takes_next_to_nothing() -> None:
    rope = build("cube-rope").simulate(frames=24)
    loose, closer = (encode(rope, tolerance=tolerance) for tolerance in (0.06, 0.04))
    assert loose.sections["MODL"] < 130
    assert size(loose) < size(closer)


def test_what_stands_still_costs_nothing_when_displacements_start_from_the_first_frame() -> None:
    points = np.random.default_rng(7).normal(size=(1, 40, 3)).astype(np.float32).repeat(9, axis=0)
    still = Displacements(points, points[0].astype(np.float64), 1e-6)
    assert still.largest == 0.0
    assert still.functions("trajectories")[0].size == 0
    assert still.spread("trajectories", 1e-6) == still.spread("shapes", 1e-6) == 0.0


def test_shapes_and_trajectories_both_carry_all_of_the_motion() -> None:
    sequence = blend_shapes()
    moved = Displacements(sequence.read_frames(0, 60), sequence.read_frames(0, 1)[0].astype(np.float64), 1e-3)
    kinds: tuple[TimeFunctions, ...] = ("trajectories", "shapes")
    for basis in kinds:
        energies, functions = moved.functions(basis)
        assert np.allclose(functions.T @ functions, np.eye(energies.size), atol=1e-9)
        assert moved.explained(energies.size, basis) == pytest.approx(1.0, abs=1e-4)
    assert moved.functions("shapes")[0].size == 3


@pytest.mark.parametrize("frames", [30, 200])
def test_energies_alone_are_those_of_principal_axes(frames: int) -> None:
    rows = np.random.default_rng(3).normal(size=(300, frames)) * 0.7 ** np.arange(frames)
    squares = rows.T @ rows
    for least in (1e-6, 1e-3, 1e9):
        assert principal_energies(squares, least) == pytest.approx(principal_axes(squares, least)[0], abs=1e-9)


def waving_sheet(rows: int = 60, frames: int = 24) -> ArraySequence:
    """A sheet of so many vertices that it counts as large, with waves that run over it, higher at one end."""
    x, y = np.meshgrid(np.arange(rows), np.arange(rows))
    at = np.arange(frames)[:, None, None]
    height = 0.002 * x * x * np.sin(0.3 * x + 0.4 * at) + 0.5 * np.cos(0.2 * y - 0.3 * at)
    flat = np.broadcast_to(np.stack([x, y], axis=-1), (frames, rows, rows, 2))
    points = np.concatenate([flat, height[..., None]], axis=-1).reshape(frames, -1, 3)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, rows))])


def fitter_of(sequence: ArraySequence, bound: float) -> tuple[GroupFitter, SpaceBasis]:
    points = sequence.read_frames(0, sequence.frame_count)
    reference = quantise_reference(points[0], 0.4 * bound)
    steps = {"bound": bound, "unit": bound, "residual_step": residual_step(bound, float(np.abs(points).max()))}
    fitter = GroupFitter(points, reference.points, points[0], times=sequence.times, **steps)
    basis = build_space_basis("patch", sequence.objects, reference.grid, points=64, functions=MOST_FUNCTIONS)
    return fitter, basis


@pytest.mark.parametrize("time", TIME_FUNCTIONS)
@pytest.mark.parametrize("origin", ORIGINS)
def test_estimates_of_a_large_mesh_are_near_to_what_fits_take(time: TimeFunctions, origin: Origin) -> None:
    fitter, basis = fitter_of(waving_sheet(), 0.02)
    assert fitter.is_large
    if time == "poses" and not fitter.displacements(origin).has_poses:
        pytest.skip("no few frames span the others")
    counter = bit_counter(fitter, basis)
    for more in (-4, 0, 4):
        choice = replace(fitter.first_choice, time=time, origin=origin, step=fitter.first_choice.step + more)
        counter.prepare(choice)
        assert counter.bits(choice) == pytest.approx(fitter.fit(basis, choice).bits, rel=0.15)


def test_estimates_from_some_nodes_are_near_to_those_from_all(monkeypatch: pytest.MonkeyPatch) -> None:
    fitter, basis = fitter_of(waving_sheet(rows=120), 0.02)
    choice = fitter.first_choice
    counters = []
    for depth in (None, 4):
        monkeypatch.setattr("pdecodec.codec.encode.estimate.WHOLE_DEPTHS", depth)
        counters.append(bit_counter(fitter, basis))
    whole, some = counters
    assert isinstance(some, Estimate)
    assert isinstance(whole, Estimate)
    assert some.sample.chosen.size < 0.75 * whole.sample.chosen.size
    assert some.bits(choice) == pytest.approx(whole.bits(choice), rel=0.1)


def test_space_bases_are_compared_on_the_same_vertices() -> None:
    sequence = waving_sheet()
    fitter, basis = fitter_of(sequence, 0.02)
    grid_points = quantise_reference(sequence.read_frames(0, 1)[0], 0.4 * 0.02).grid
    first = Estimate(fitter, basis, compares_bases=True)
    assert first.sample.vertices.size < 0.7 * basis.order.size
    for points in (32, 128):
        other = build_space_basis("patch", sequence.objects, grid_points, points=points, functions=MOST_FUNCTIONS)
        found = Estimate(fitter, other, first)
        assert found.sample.elements.size != first.sample.elements.size
        assert set(found.sample.vertices) == set(first.sample.vertices)
        assert found.sample.weight == first.sample.weight


def test_more_vertices_are_looked_at_where_space_bases_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pdecodec.codec.encode.estimate.SAMPLED_SHARE", 0.9)
    monkeypatch.setattr("pdecodec.codec.encode.estimate.ENOUGH_VERTICES", 1200)
    monkeypatch.setattr("pdecodec.codec.encode.estimate.ENOUGH_TO_COMPARE", 2400)
    fitter, basis = fitter_of(waving_sheet(), 0.02)
    few, many = (Estimate(fitter, basis, compares_bases=compares).sample.vertices.size for compares in (False, True))
    assert few == pytest.approx(1200, rel=0.1)
    assert many == pytest.approx(2400, rel=0.1)


@pytest.mark.parametrize("rows", [12, 60])
def test_a_step_is_refined_towards_the_better_one_of_those_beside_it(rows: int) -> None:
    search = GroupSearch(*fitter_of(waving_sheet(rows), 0.02))
    chosen = search.choose([search.fitter.first_choice])
    step = chosen.choice.step
    beside = {way: search.bits(replace(chosen.choice, step=step + 2 * way)) for way in (1, -1)}
    assert chosen.bits <= min(beside.values())
    looked_at: list[int] = []
    look = search.look

    def note(choices: Sequence[GroupChoice]) -> None:
        looked_at.extend(choice.step for choice in choices)
        look(choices)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(search, "look", note)
        tuned = search.tune(chosen.choice)
    assert tuned.bits <= chosen.bits
    assert set(looked_at) - {step} == {step + min(beside, key=beside.__getitem__)}


def test_rounding_again_towards_what_is_missed_takes_fewer_bits_and_keeps_the_bound() -> None:
    sequence = waving_sheet()
    fitter, basis = fitter_of(sequence, 0.02)
    choice = replace(fitter.first_choice, step=fitter.first_choice.step + 2)
    once, often = fitter.fit(basis, choice), Refinement(fitter, basis, choice).refined(6).best
    assert often.bits < once.bits
    assert fitter.encode(often, basis).largest_square <= 0.02**2


def test_rounding_again_ends_where_it_saves_little(monkeypatch: pytest.MonkeyPatch) -> None:
    fitter, basis = fitter_of(waving_sheet(), 0.02)
    choice = replace(fitter.first_choice, step=fitter.first_choice.step + 2)
    fitted, fits = GroupFitter.fitted, list[GroupEntry]()

    def count(self: GroupFitter, basis: SpaceBasis, entry: GroupEntry, *others: Any, **options: Any) -> FittedGroup:
        fits.append(entry)
        return fitted(self, basis, entry, *others, **options)

    def fits_of(least_gain: float) -> int:
        fits.clear()
        Refinement(fitter, basis, choice).refined(6, least_gain)
        return len(fits)

    monkeypatch.setattr(GroupFitter, "fitted", count)
    assert fits_of(0.0) == 7
    assert fits_of(0.9) == 2  # no pass saves that much: the first is the last
    monkeypatch.setattr("pdecodec.codec.encode.refinement.MOST_RESIDUALS", 0.0)
    assert fits_of(0.9) == 1
    assert fits_of(0.0) == 7


def test_what_is_not_measured_at_once_takes_as_much_when_it_is() -> None:
    fitter, basis = fitter_of(waving_sheet(), 0.02)
    later = fitter.fit(basis, fitter.first_choice, is_measured=False)
    assert later.bits == np.inf
    assert later.measured(basis).bits == fitter.fit(basis, fitter.first_choice).bits


def test_positions_are_added_up_in_float64_where_float32_takes_too_much_of_its_margin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fitter, basis = fitter_of(waving_sheet(), 0.02)
    fitted = fitter.fit(basis, fitter.first_choice)
    single = fitter.encode(fitted, basis)
    monkeypatch.setattr("pdecodec.codec.encode.group_fit.SINGLE_MARGIN", 1e-9)
    exact = fitter.encode(fitted, basis)
    assert (single.entry.single, exact.entry.single) == (True, False)
    assert exact.chunks[1] == single.chunks[1]
    assert 0.0 < exact.largest_square <= fitter.bound**2
    assert exact.largest_square == pytest.approx(single.largest_square, rel=1e-3)


def test_motions_of_other_functions_are_not_compared() -> None:
    _, basis = fitter_of(waving_sheet(), 0.02)
    time, reference = np.ones((2, 3, 1)), np.zeros((basis.order.size, 3))
    one, other = (
        _core.Motion(basis.core, np.zeros((basis.functions, axes), np.int64), axes, 1.0, True, None, 1)
        for axes in (1, 3)
    )
    assert _core.farthest_apart(one, one, time, reference, 1) == 0.0
    with pytest.raises(ValueError, match="the same functions and vertices"):
        _core.farthest_apart(one, other, time, reference, 1)
    with pytest.raises(ValueError, match="do not fit together"):
        _core.farthest_apart(one, one, time[:, :1], reference, 1)


def test_parts_of_a_group_are_compared_with_it_on_the_same_elements() -> None:
    fitter, basis = fitter_of(waving_sheet(), 0.02)
    whole = bit_counter(fitter, basis)
    part = bit_counter(fitter.part(slice(0, 12)), basis, part_of=whole)
    assert isinstance(whole, Estimate)
    assert isinstance(part, Estimate)
    assert np.array_equal(part.sample.elements, whole.sample.elements)
    assert part.sample.weight == whole.sample.weight
    assert part.sample.points.shape == (12, *whole.sample.points.shape[1:])


def unlike_frames(rows: int = 50, frames: int = 40) -> ArraySequence:
    """A sheet, flat at first, whose frames are smooth and have nothing in common."""
    random = np.random.default_rng(11)
    waves = np.cos(np.pi * np.outer(np.arange(12), (np.arange(rows) + 0.5) / rows))
    moved = np.einsum("fabx,ai,bj->fijx", random.normal(size=(frames, 12, 12, 3)), waves, waves)
    flat = np.stack([*np.meshgrid(np.arange(rows), np.arange(rows)), np.zeros((rows, rows))], axis=-1)
    moved[0] = 0.0
    points = (flat + 0.3 * moved).reshape(frames, -1, 3)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, rows))])


@pytest.fixture
def without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have little effort encode clips of any size as it does large ones."""
    monkeypatch.setitem(EFFORTS, "fast", replace(EFFORTS["fast"], searched_clip=0))


@pytest.mark.usefixtures("without_a_search")
def test_dense_motion_is_encoded_fast_in_cosines_over_short_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    smooth = encode(waving_sheet(frames=40), tolerance=1e-3, effort="fast")
    assert smooth.groups == 1
    assert smooth.summary.startswith("trajectories")
    dense = encode(unlike_frames(), tolerance=1e-3, effort="fast")
    assert dense.groups == 4
    assert dense.summary.startswith("cosines x patch: 10 functions of time in 4 groups")
    assert dense.bound is not None
    assert dense.max_error <= dense.bound
    monkeypatch.setenv("PDECODEC_THREADS", "1")
    assert encode(unlike_frames(), tolerance=1e-3, effort="fast").data == dense.data


@pytest.mark.usefixtures("without_a_search")
def test_without_a_search_steps_follow_what_residuals_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waves are smooth: with the step that leaves the usual mean error next to no position needs a residual."""
    monkeypatch.setattr("pdecodec.codec.encode.auto_profile.LONGEST_GROUP", 12)
    monkeypatch.setattr("pdecodec.codec.encode.group_fit.MEAN_ERROR", 0.1)
    sequence = waving_sheet(frames=72)

    def steps() -> tuple[int, list[float]]:
        report = encode(sequence, tolerance=1e-3, effort="fast")
        assert report.bound is not None
        assert report.max_error <= report.bound
        return len(report.data), [entry.step for entry in open_animation(report.data).groups]

    size, followed = steps()
    assert all(step > 1.5 * followed[0] for step in followed[2:])
    monkeypatch.setattr("pdecodec.codec.encode.auto_profile.OUT_OF_BALANCE", ())
    usual_size, usual = steps()
    assert max(usual) < 1.5 * usual[0]
    assert size < 0.95 * usual_size


@pytest.mark.usefixtures("without_a_search")
def test_without_a_search_a_reference_frame_is_made_finer_where_that_takes_next_to_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert reference_step(unlike_frames(), 0.05, "fast") > 0.32
    monkeypatch.setattr("pdecodec.codec.encode.model_choice.FINER_FROM", 0)
    assert reference_step(unlike_frames(), 0.05, "fast") < 0.26
    assert reference_step(turning_pieces(20), 0.05, "fast") > 0.32


def test_more_effort_takes_no_more_bits_where_its_own_search_finds_little(monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = blend_shapes()
    blind = replace(EFFORTS["best"], space_bases=(("patch", 256),), more_of_small=(), fine_steps=False)
    monkeypatch.setitem(EFFORTS, "best", blind)
    best, usual = (encode(sequence, tolerance=1e-3, effort=effort) for effort in ("best", "default"))
    assert size(best) <= size(usual)


@pytest.mark.parametrize("make", [blend_shapes, turning_pieces])
def test_more_effort_takes_no_more_bytes_of_a_whole_file(make: Callable[[], ArraySequence]) -> None:
    best, usual = (encode(make(), tolerance=1e-2, effort=effort) for effort in ("best", "default"))
    assert size(best) <= size(usual)


@pytest.mark.parametrize("make", [blend_shapes, keyed_shapes, turning_pieces])
def test_little_effort_takes_little_more_bits_of_small_clips(make: Callable[[], ArraySequence]) -> None:
    fast, usual = (size(encode(make(), tolerance=1e-3, effort=effort)) for effort in ("fast", "default"))
    assert fast <= 1.07 * usual


def test_displacements_from_another_shape_have_the_principal_functions_of_their_own() -> None:
    points = waving_sheet().read_frames(0, 24)
    shape = points[0].astype(np.float64)
    reference = np.round(shape, 1)
    beside = Displacements(points, shape, 1e-2, beside=Displacements(points, reference, 1e-2))
    kinds: tuple[TimeFunctions, ...] = ("trajectories", "shapes")
    for kind in kinds:
        (own, _), (found, _) = Displacements(points, shape, 1e-2).functions(kind), beside.functions(kind)
        assert found == pytest.approx(own, rel=1e-6)


@pytest.mark.parametrize("origin", ORIGINS)
def test_parts_of_displacements_have_what_they_would_find_themselves(origin: Origin) -> None:
    fitter, basis = fitter_of(waving_sheet(), 0.02)
    frames = slice(5, 16)
    part, alone = (each.displacements(origin) for each in (fitter.part_of_found(frames), fitter.part(frames)))
    assert part.part_of is not None
    project = partial(basis.project_some, subbands=basis.subbands_of(np.arange(0, basis.element_count, 3)))
    longer = Sight(project)
    kinds: tuple[TimeFunctions, ...] = ("trajectories", "shapes", "cosines")
    for kind in kinds:
        found = part.some_coefficients(kind, sight=Sight(project, longer))
        assert found == pytest.approx(alone.some_coefficients(kind, sight=Sight(project)), abs=1e-3 * fitter.unit)
        if kind != "cosines":
            assert part.functions(kind)[0] == pytest.approx(alone.functions(kind)[0], rel=1e-6)
    part.put_aside()
    assert part.part_of is None
    assert part.some_coefficients("shapes") == pytest.approx(alone.some_coefficients("shapes"), abs=1e-3 * fitter.unit)


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize(
    "frames", [12, 200]
)  # of few frames all functions are looked for, of many those that they need
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_what_some_elements_see_of_displacements_is_what_they_see_of_coefficients(
    origin: Origin, frames: int, precision: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    if precision is np.float64:
        monkeypatch.setattr("pdecodec.codec.encode.displacements.SINGLE_ROWS", math.inf)
    fitter, basis = fitter_of(waving_sheet(frames=frames), 0.02)
    moved, subbands = fitter.displacements(origin), basis.subbands_of(np.arange(0, basis.element_count, 3))
    sight = Sight(partial(basis.project_some, subbands=subbands))
    kinds: tuple[TimeFunctions, ...] = ("trajectories", "shapes", "cosines")
    for kind in kinds:
        some = slice(1, None, 2)
        wanted = basis.project_some(moved.some_coefficients(kind, some), subbands)
        assert precision is np.float32 or wanted.dtype == np.float64
        rounding = 0.0 if wanted.dtype == np.float64 else 1e-6 * float(np.abs(wanted).max())
        found = moved.some_coefficients(kind, some, sight)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-3 * fitter.unit + rounding)


def test_channels_quantised_in_blocks_are_as_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    _, basis = fitter_of(waving_sheet(), 0.02)
    values = np.random.default_rng(1).normal(size=(basis.order.size, 150))
    monkeypatch.setattr("pdecodec.codec.encode.quantisation.BLOCK_BYTES", 8 * 48 * basis.functions)
    step, zone = 1.0, (0.6, 0.95)
    wanted, largest = quantise_sparsely(basis.project(values), step, 3, zone)
    found, found_largest = quantise_on(basis, columns_of(values, 3), 50, 3, step, zone)
    assert np.array_equal(found, wanted)
    assert np.array_equal(found_largest, largest)


def test_few_frames_of_many_vertices_miss_what_each_of_them_misses() -> None:
    fitter, basis = fitter_of(waving_sheet(rows=160, frames=9), 0.02)
    group = fitter.quantised(basis, replace(fitter.first_choice, step=fitter.first_choice.step + 12))
    assert group.time_functions is not None
    time = functions_of_time(group.entry, group.time_functions.decoded, fitter.times)
    functions = group_functions(group.entry, time, group.quantised, basis)

    def missed(frames: slice) -> tuple[Residuals, float]:
        some = replace(functions, time=functions.time[frames])
        held = fitter.held(some, fitter.points[frames], basis.order)
        residuals, _, sum_of_squares = held.missing(np.zeros(len(some.time)), None, None, True, 2)
        return residuals, sum_of_squares

    together, squares = missed(slice(9))
    alone = [missed(slice(frame, frame + 1)) for frame in range(9)]
    assert together.count > 1000
    for name in ("places", "quantised"):
        parts = [getattr(residuals, name) for residuals, _ in alone]
        assert np.array_equal(getattr(together, name), np.concatenate(parts))
    assert np.array_equal(np.diff(together.frame_starts), [residuals.count for residuals, _ in alone])
    assert squares == pytest.approx(sum(of_frame for _, of_frame in alone))


@pytest.mark.parametrize(("largest", "kind"), [(2**15 - 1, np.int16), (2**15, np.int32), (2**31, np.int64)])
def test_fits_of_heavy_groups_hold_coefficients_in_few_bytes(largest: int, kind: type) -> None:
    fitter, basis = fitter_of(waving_sheet(frames=2), 0.02)
    fitter.is_heavy = True
    quantised = np.zeros((basis.functions, 2), np.int64)
    quantised[5] = largest, -largest
    entry = GroupEntry(frames=2, functions=2, basis="cosines", single=False, step=1e-12)
    quantised = np.repeat(quantised, 3, axis=1)
    fitted = fitter.fitted(basis, entry, quantised)
    assert fitted.packed.dtype == kind
    assert np.array_equal(fitted.quantised, quantised)


def test_what_is_made_of_a_heavy_group_is_heavy() -> None:
    fitter, _ = fitter_of(waving_sheet(frames=4), 0.02)
    assert not fitter.is_heavy
    fitter.is_heavy = True
    reference = np.asarray(fitter.points[0], np.float64)
    for other in (fitter.part(slice(0, 2)), fitter.at_bound(0.1, 0.1), fitter.from_reference(reference)):
        assert other.is_heavy


@pytest.mark.parametrize("effort", ["fast", "default"])
def test_groups_that_are_heavy_are_encoded_nearly_alike(effort: EffortName, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = size(encode(waving_sheet(), tolerance=1e-3, effort=effort))
    monkeypatch.setattr("pdecodec.codec.encode.group_fit.HEAVY", 0)
    monkeypatch.setattr("pdecodec.codec.encode.quantisation.BLOCK_BYTES", 0)
    report = encode(waving_sheet(), tolerance=1e-3, effort=effort)
    assert report.bound is not None
    assert report.max_error <= report.bound
    assert size(report) == pytest.approx(usual, rel=0.03)


@pytest.mark.parametrize("kind", TIME_FUNCTIONS)
def test_displacements_from_nearly_the_same_shape_have_coefficients_in_the_same_functions(kind: TimeFunctions) -> None:
    points = keyed_shapes().read_frames(0, 40)
    shape = points[0].astype(np.float64)
    usual = Displacements(points, shape, 1e-3)
    moved = Displacements(points, np.round(shape, 2), 1e-3, alike=usual)
    dual = cosines(40, 40) if kind == "cosines" else usual.functions(kind)[1]
    assert moved.coefficients(kind) == pytest.approx(moved.along(dual, kind), abs=1e-9)
