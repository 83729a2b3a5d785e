"""Baselines keep the given bound, measured on positions decoded from their bytes; and their lossless parts are
exact.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.errors import MissingExtraError
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.clips.baseline import Baseline, Encoder, Transform, UnreachableError, code_digest
from pdecodec.report.clips.ratesearch import MAX_TRIES, RateCurve, SearchResult, largest_distance
from pdecodec.research.baselines import all_baselines, available_baselines
from pdecodec.research.baselines.bspline import BSpline
from pdecodec.research.baselines.coding import (
    decode_bands,
    decode_over_mesh,
    decode_over_time,
    encode_bands,
    encode_over_mesh,
    encode_over_time,
)
from pdecodec.research.baselines.neighbours import FittedPredictor, decode_fitted, encode_fitted
from pdecodec.research.baselines.packages import Draco, Zfp
from pdecodec.research.baselines.quantised import RawFloat16, RawFloat32
from pdecodec.research.baselines.skinned import RigidSkinning, SkinningCosines
from pdecodec.research.baselines.skinning import MAX_WEIGHTS, fit_skinning, simplex_solution
from pdecodec.research.baselines.transforms import (
    Coddyac,
    Corrected,
    CosineInTime,
    FittedCoddyac,
    PrincipalShapes,
    principal_components,
)
from pdecodec.research.baselines.traversal import Traversal, traverse
from tests.support.mesh_cases import connectivities, connectivity_of, grid

ROWS, COLUMNS, FRAMES = 6, 20, 12


def wave(frames: int = FRAMES, rows: int = ROWS, columns: int = COLUMNS) -> Float32Array:
    """Return positions of a sheet that waves and drifts, with as many vertices as ``grid(rows, columns)``."""
    u, v = np.linspace(0, 2, columns), np.linspace(0, 1, rows)[:, None]
    t = np.linspace(0, 1, frames)[:, None, None]
    x, y = np.broadcast_to(u + 0.3 * t, (frames, rows, columns)), np.broadcast_to(v, (frames, rows, columns))
    z = 0.2 * np.sin(4 * u - 5 * t + v)
    return np.stack([x, y, z], axis=-1).reshape(frames, -1, 3).astype(np.float32)


def noise(*shape: int, seed: int = 0) -> Float32Array:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


SHEET = grid(ROWS, COLUMNS)

CASES = {
    "sheet": (SHEET, wave()),
    "lines": (connectivity_of(10, lines=[range(4), range(4, 10)]), noise(5, 10, 3)),
    "points": (Connectivity(10), noise(5, 10, 3)),
    "part of the vertices": (connectivity_of(9, [[0, 4, 8], [4, 8, 2, 6, 1]]), noise(3, 9, 3)),
    "static": (grid(3, 4), np.repeat(noise(1, 12, 3), 6, axis=0)),
    "one frame": (grid(3, 4), noise(1, 12, 3)),
    "one vertex": (Connectivity(1), noise(4, 1, 3)),
    "one still vertex": (Connectivity(1), np.ones((3, 1, 3), np.float32)),
    "far from the origin": (grid(3, 4), 1e4 + noise(4, 12, 3)),
    "five frames of ten vertices": (grid(2, 5), noise(5, 10, 3)),
}


def here(baseline: Baseline) -> Baseline:
    """Return the baseline; if it cannot run here, skip the test with the reason."""
    reason = baseline.missing()
    if reason is not None:
        pytest.skip(reason)
    return baseline


def smallest(baseline: Baseline, points: Float32Array, connectivity: Connectivity, bound: float) -> SearchResult:
    return RateCurve(here(baseline), points, connectivity).reach(bound)


def by_name(*baselines: Baseline) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("baseline", baselines, ids=lambda baseline: baseline.name)


EXTREMES = {
    **CASES,
    "very large": (grid(3, 4), 1e6 * noise(4, 12, 3)),
    "very small": (grid(3, 4), 1e-6 * noise(4, 12, 3)),
    "very far from the origin": (grid(3, 4), 1e6 + noise(4, 12, 3)),
    "a frame far from the others": (grid(3, 4), noise(4, 12, 3) * np.array([1, 1, 1e9, 1], np.float32)[:, None, None]),
    "all at the origin": (grid(3, 4), np.zeros((4, 12, 3), np.float32)),
}


@pytest.mark.parametrize("case", EXTREMES)
@by_name(*all_baselines())
def test_every_baseline_keeps_a_tolerance_or_refuses_it_by_name(baseline: Baseline, case: str) -> None:
    connectivity, points = EXTREMES[case]
    curve, scale = RateCurve(here(baseline), points, connectivity), frame_scale(points[0])
    for tolerance in (1e-1, 1e-4, 1e-9, 0.0):
        refusal = ""
        try:
            result = curve.reach(tolerance * scale)
        except UnreachableError as error:
            refusal = str(error)
        if refusal:
            why = "(is .* allowed|are more than|need more than|beyond its|off where|is too large for float16)"
            assert re.match(rf"{re.escape(baseline.name)}: .*{why}", refusal)
            assert tolerance < 1e-1 or isinstance(baseline, RawFloat16) or case == "a frame far from the others"
            continue
        data = baseline.prepare(points, connectivity)(result.length)
        decoded = baseline.decode(data, connectivity)
        assert (decoded.shape, len(data)) == (points.shape, result.size)
        assert largest_distance(points, decoded) == pytest.approx(result.distortion.max_error, rel=1e-12, abs=0.0)
        assert result.distortion.max_error <= tolerance * scale


@pytest.mark.parametrize("values", [wave()[..., 2:], noise(1, 6, 1), noise(3, 1, 1)], ids=["wave", "frame", "row"])
@by_name(*(baseline for baseline in all_baselines() if baseline.codes_fields))
def test_values_of_a_field_keep_an_absolute_error(baseline: Baseline, values: Float32Array) -> None:
    faces = Connectivity(values.shape[1])
    found = smallest(baseline, values, faces, 1e-3)
    assert np.abs(baseline.decode(found.data, faces) - values).max() <= 1e-3


@by_name(*[baseline for baseline in all_baselines() if baseline.adjustable])
def test_a_tighter_bound_takes_more_bytes(baseline: Baseline) -> None:
    here(baseline)
    sizes = [smallest(baseline, wave(), SHEET, bound).size for bound in (5e-2, 5e-3, 5e-4)]
    assert sizes[0] < sizes[1] < sizes[2]


@by_name(*all_baselines())
def test_the_same_input_gives_the_same_bytes(baseline: Baseline) -> None:
    here(baseline)
    first, second = (baseline.prepare(wave(), SHEET)(1e-3) for _ in range(2))
    assert first == second


@by_name(PrincipalShapes(), Coddyac())
def test_motion_of_one_degree_of_freedom_costs_a_component_whatever_the_frames(baseline: Baseline) -> None:
    shape = wave()[0]
    sizes = []
    for frames in (20, 80):
        along = np.sin(np.linspace(0, 3, frames))[:, None, None] * noise(1, len(shape), 3, seed=1)
        sizes.append(smallest(baseline, (shape + along).astype(np.float32), SHEET, 1e-2).size)
    assert sizes[1] < 1.5 * sizes[0]  # four times as many frames: the shape stays the same, and its weights are smooth


def two_limbs(frames: int = 20) -> Float32Array:
    """Return as many vertices as SHEET has: half of the columns stand still, half make two turns about an axis
    and drift.
    """
    limb = wave(1)[0].astype(np.float64).reshape(ROWS, COLUMNS, 3)
    turned = np.repeat(limb[None], frames, axis=0)
    angles, half = np.linspace(0.0, 4.0 * np.pi, frames), limb[:, COLUMNS // 2 :]
    for frame, angle in enumerate(angles):
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        turned[frame, :, COLUMNS // 2 :] = half @ turn.T + [0.1 * frame, 0.0, 0.0]
    return turned.reshape(frames, -1, 3).astype(np.float32)


@pytest.mark.parametrize("rigid", [True, False])
def test_two_rigid_limbs_are_explained_by_two_bones_without_corrections(rigid: bool) -> None:
    points = two_limbs()
    skinning = fit_skinning(points, 2, rigid=rigid)
    np.testing.assert_allclose(skinning.positions(), points, atol=1e-5)
    linear = skinning.transforms[..., :3]
    if rigid:
        np.testing.assert_allclose(
            linear @ linear.transpose(0, 1, 3, 2), np.broadcast_to(np.eye(3), linear.shape), atol=1e-9
        )
    size = smallest(RigidSkinning(2), points, SHEET, 1e-3).size
    assert size < 0.5 * smallest(CosineInTime(), points, SHEET, 1e-3).size


def test_affine_bones_follow_a_stretch_that_rigid_ones_cannot() -> None:
    stretched = wave(1) * (1.0 + np.linspace(0.0, 1.0, 9)[:, None, None] * [1.0, 0.5, 0.0]).astype(np.float32)
    affine, rigid = (fit_skinning(stretched, 1, rigid=rigid).positions() for rigid in (False, True))
    np.testing.assert_allclose(affine, stretched, atol=1e-6)
    assert np.abs(rigid - stretched).max() > 0.1


def test_weights_are_convex_and_at_most_four_a_vertex() -> None:
    weights = fit_skinning(noise(9, 50, 3), 7, rigid=True).weights
    assert (weights >= 0.0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert np.count_nonzero(weights, axis=1).max() == MAX_WEIGHTS


def test_convex_weights_are_those_of_least_error() -> None:
    random = np.random.default_rng(0)
    factors = random.normal(size=(40, 6, 4))
    wanted = random.normal(size=(40, 6))
    found = simplex_solution(factors.transpose(0, 2, 1) @ factors, np.einsum("nrk,nr->nk", factors, wanted))
    tried = random.dirichlet(np.full(4, 0.5), size=20_000)
    for rows, right, weights in zip(factors, wanted, found, strict=True):
        best = ((tried @ rows.T - right) ** 2).sum(axis=1).min()
        assert ((rows @ weights - right) ** 2).sum() <= best + 1e-6
        assert (weights >= 0.0).all()
        assert weights.sum() == pytest.approx(1.0)


def test_float32_comes_back_to_the_bit_and_float16_rounded() -> None:
    points = noise(3, 7, 3)
    for baseline, expected in ((RawFloat32(), points), (RawFloat16(), points.astype(np.float16).astype(np.float32))):
        decoded = baseline.decode(baseline.prepare(points, Connectivity(7))(1.0), Connectivity(7))
        assert np.array_equal(decoded, expected)


def test_draco_keeps_vertices_that_stand_in_one_place() -> None:
    sheet, points = grid(3, 4), noise(3, 12, 3)
    points[1:, 7] = points[1:, 2]
    decoded = here(Draco()).decode(Draco().prepare(points, sheet)(1e-4), sheet)
    assert largest_distance(points, decoded) <= 1e-4


def test_corrections_touch_only_what_the_transform_leaves_beyond_the_bound() -> None:
    points, bound = wave(), 1e-2
    transform = CosineInTime()
    baseline = Corrected(transform)
    data = baseline.prepare(points, SHEET)(bound)
    inner = data[16 : 16 + int.from_bytes(data[8:16], "little")]
    plain, corrected = transform.decode(inner, SHEET), baseline.decode(data, SHEET)
    missed = np.sqrt(((points.astype(np.float64) - plain) ** 2).sum(axis=2)) > bound
    changed = (plain != corrected).any(axis=2)
    assert 0 < missed.sum() < missed.size / 4
    assert np.array_equal(changed, missed)
    assert largest_distance(points, corrected) <= bound


class Rounding(Baseline):
    """A baseline that rounds to multiples of the length, and stores the length in its bytes."""

    name = "rounding"
    source = "this test"

    def __init__(self, floor: float = 0.0) -> None:
        self.floor = floor
        self.lengths: list[float] = []

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        def encode(length: float) -> bytes:
            if length < self.floor:
                raise UnreachableError(f"no finer than {self.floor}")
            self.lengths.append(length)
            rounded = np.rint(points / length) * length
            return rounded.astype(np.float32).tobytes() + bytes(int(100 / length))

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        return np.frombuffer(data[: 4 * 3 * 1000], np.float32).reshape(1, 1000, 3)


def test_the_search_comes_close_to_the_bound_in_few_tries() -> None:
    points, baseline = noise(1, 1000, 3), Rounding()
    result = smallest(baseline, points, Connectivity(1000), 0.01)
    assert 0.9 * 0.01 < result.distortion.max_error <= 0.01
    assert len(baseline.lengths) <= MAX_TRIES / 2
    assert result.length in baseline.lengths


def test_the_search_names_the_reason_where_no_length_is_fine_enough() -> None:
    with pytest.raises(UnreachableError, match=r"rounding: no finer than 0\.1"):
        smallest(Rounding(floor=0.1), noise(1, 1000, 3), Connectivity(1000), 0.001)


def test_a_length_that_cannot_be_encoded_does_not_lose_what_was_found() -> None:
    class Ceiling(Rounding):
        """A baseline that refuses any length above the first one requested."""

        def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
            encode = super().prepare(points, connectivity)

            def limited(length: float) -> bytes:
                if self.lengths:
                    raise UnreachableError("no coarser than this")
                return encode(length)

            return limited

    result = smallest(Ceiling(), noise(1, 1000, 3), Connectivity(1000), 0.1)
    assert result.length == 0.1


def test_a_baseline_without_a_length_is_encoded_once_for_all_bounds() -> None:
    prepared = []

    class Counted(RawFloat32):
        def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
            prepared.append(points)
            return super().prepare(points, connectivity)

    curve = RateCurve(Counted(), wave(), SHEET)
    assert len(prepared) == 0
    first, second = curve.reach(1e-3), curve.reach(1e-5)
    assert first is second
    assert (len(prepared), len(curve.tries), first.distortion.max_error) == (1, 1, 0.0)


def test_trials_for_one_bound_are_used_for_the_others() -> None:
    points, baseline, bounds = noise(1, 1000, 3), Rounding(), (0.1, 0.03, 0.01, 0.003, 0.001)
    curve = RateCurve(baseline, points, Connectivity(1000))
    results = [curve.reach(bound) for bound in bounds]
    assert len(baseline.lengths) == len(curve.tries) <= 3 * len(bounds)
    for result, bound in zip(results, bounds, strict=True):
        assert 0.8 * bound <= result.distortion.max_error <= bound
        assert curve.reach(bound).size <= result.size
        assert result in curve.tries
    assert len(baseline.lengths) == len(curve.tries)
    assert [made.length for made in curve.tries] == sorted(baseline.lengths)


def test_a_search_for_a_transform_codes_only_its_result() -> None:
    written = []

    class Counted(CosineInTime):
        def write(self, quantised: Any, connectivity: Connectivity) -> bytes:
            written.append(quantised)
            return super().write(quantised, connectivity)

    curve = RateCurve(Counted(), wave(), SHEET)
    sizes = [curve.reach(bound).size for bound in (1e-2, 1e-3, 1e-4)]
    assert sizes == [made.size for made in reversed(curve.tries)]
    assert len(written) == 3


def numbers_of(quantised: object) -> dict[str, object]:
    """Return the numbers that a transform rounded, by name; names of nested parts are prefixes."""
    found: dict[str, object] = {}
    for name, value in vars(quantised).items():
        parts = numbers_of(value) if dataclasses.is_dataclass(value) else {"": value}
        found.update({f"{name}.{part}": number for part, number in parts.items()})
    return found


@pytest.mark.parametrize("case", CASES)
@by_name(BSpline(), CosineInTime(), PrincipalShapes(), Coddyac(), FittedCoddyac(), RigidSkinning(8), SkinningCosines())
def test_a_transform_gives_the_numbers_it_wrote_and_positions_of_them_to_the_bit(
    baseline: Transform[object], case: str
) -> None:
    connectivity, points = CASES[case]
    quantised = baseline.analyse(points, connectivity)(1e-2)
    again = baseline.read(baseline.write(quantised, connectivity), connectivity)
    for name, expected in numbers_of(quantised).items():
        assert np.array_equal(numbers_of(again)[name], expected)
    assert np.array_equal(baseline.synthesise(again, connectivity), baseline.synthesise(quantised, connectivity))


def test_the_coarsest_power_of_two_that_keeps_the_bound_is_found_for_zfp() -> None:
    encode, decode = here(Zfp()).prepare(wave(), SHEET), Zfp().decode
    curve = RateCurve(Zfp(), wave(), SHEET)
    lengths = [2.0**power for power in range(-20, 4)]
    errors = [largest_distance(wave(), decode(encode(length), SHEET)) for length in lengths]
    for bound in (1e-1, 1e-4, 7e-3, 1.7e-3, 4e-4):
        expected = max(length for length, error in zip(lengths, errors, strict=True) if error <= bound)
        assert curve.reach(bound).length == expected


def test_a_missing_package_is_named_with_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    able, reasons = available_baselines()
    assert {baseline.package for baseline in able} == {None}
    assert [reason.split()[0] for reason in reasons] == ["quantise", "meshopt", "Draco", "zfp", "SZ3", "SPERR"]
    with pytest.raises(MissingExtraError, match=r"Draco a frame needs the package DracoPy: pip install 'pdecodec"):
        RateCurve(Draco(), wave(), SHEET)


def test_baselines_have_names_and_versions_of_their_own() -> None:
    able, _ = available_baselines()
    assert len({baseline.name for baseline in all_baselines()}) == len(all_baselines())
    assert len({baseline.version() for baseline in able}) == len(able)
    assert {baseline.name for baseline in all_baselines() if not baseline.published} == {
        f"{baseline.name}, corrected"
        for baseline in (
            *(CosineInTime(), PrincipalShapes(), Coddyac(), FittedCoddyac(), RigidSkinning(), SkinningCosines()),
        )
    } | {FittedCoddyac().name}


def test_a_version_follows_the_code_and_not_its_comments(tmp_path: Path) -> None:
    digests = []
    for name, text in (("one", "a = 1"), ("two", '"""Text."""\n\na = 1  # why'), ("three", "a = 2")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "rounding.py").write_text(text)
        digests.append(code_digest(tmp_path / name))
    assert digests[0] == digests[1] != digests[2]


integers = st.integers(-(2**40), 2**40) | st.integers(-3, 3)


@settings(deadline=None)
@given(st.lists(st.lists(integers, min_size=3, max_size=3), max_size=6))
def test_bands_of_any_integers_come_back(bands: list[list[int]]) -> None:
    values = np.array(bands, np.int64).reshape(len(bands), 3)
    assert np.array_equal(decode_bands(encode_bands(values), *values.shape), values)


@pytest.mark.parametrize("spread", [0.2, 3.0, 200.0])
def test_bands_of_one_distribution_cost_within_three_percent_of_its_entropy(spread: float) -> None:
    values = np.rint(np.random.default_rng(0).laplace(scale=spread, size=(20, 5000))).astype(np.int64)
    edges = (np.arange(-20_000, 20_001) + 0.5) / spread
    cumulative = np.where(edges < 0, 0.5 * np.exp(-np.abs(edges)), 1 - 0.5 * np.exp(-np.abs(edges)))
    probabilities = np.diff(cumulative)
    probabilities = probabilities[probabilities > 1e-300]
    entropy = -(probabilities * np.log2(probabilities)).sum() * values.size / 8
    assert len(encode_bands(values)) < 1.03 * entropy


@settings(deadline=None)
@given(connectivities())
def test_a_traversal_has_every_vertex_once_and_predicts_from_earlier_places(connectivity: Connectivity) -> None:
    traversal = traverse(connectivity)
    assert np.array_equal(np.sort(traversal.order), np.arange(connectivity.vertex_count))
    owner = np.repeat(np.arange(traversal.order.size), np.diff(traversal.starts))
    assert (traversal.corners < owner[:, None]).all()
    values = np.random.default_rng(0).integers(-1000, 1000, (connectivity.vertex_count, 2))
    assert np.array_equal(traversal.restored(traversal.residuals(values)), values)


def test_parallelograms_that_are_not_those_of_the_places_are_refused() -> None:
    values = np.zeros((3, 2), np.int64)
    wrong_starts = [([0, 0, 1], [[0, 0, 0]]), ([0, 0, 0, 2], [[0, 0, 0]]), ([0, 1, 0, 1], [[0, 0, 0]])]
    for starts, corners in [*wrong_starts, ([0, 0, 0, 1], [[0, 3, 0]]), ([0, 0, 0, 1], [[0, -1, 0]])]:
        with pytest.raises(ValueError, match="do not fit the starts"):
            Traversal(np.arange(3), np.array(starts), np.array(corners)).residuals(values)


def test_parallelograms_predict_a_flat_even_sheet_exactly() -> None:
    traversal = traverse(SHEET)
    row, column = np.divmod(traversal.order, COLUMNS)
    values = np.stack([7 * row - 3 * column, column], axis=1)
    known = np.diff(traversal.starts) > 0
    assert known.sum() == SHEET.vertex_count - 3  # each vertex except those of the first triangle has one parallelogram
    assert not traversal.residuals(values)[known].any()


@settings(deadline=None)
@given(connectivities(), st.integers(0, 4), st.integers(0, 2**32 - 1))
def test_columns_come_back_over_mesh_and_time(connectivity: Connectivity, columns: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    values = np.rint(random.laplace(size=(connectivity.vertex_count, columns)) * 30).astype(np.int64)
    traversal = traverse(connectivity)
    assert np.array_equal(decode_over_mesh(encode_over_mesh(values, traversal), columns, traversal), values)
    assert np.array_equal(decode_fitted(encode_fitted(values, traversal), columns, traversal), values)
    assert np.array_equal(decode_over_time(encode_over_time(values), columns, len(values)), values)


def test_fitted_weights_learn_what_parallelograms_miss() -> None:
    """Parallelograms miss linear values on a sheet of uneven rows and columns; fitted weights learn them."""
    traversal, random = traverse(SHEET), np.random.default_rng(0)
    across = np.cumsum(random.uniform(0.3, 3.0, COLUMNS)) * np.ones((ROWS, 1)) + random.uniform(0, 0.3, (ROWS, 1))
    down = np.cumsum(random.uniform(0.3, 3.0, (ROWS, COLUMNS)), axis=0)
    sheet = np.stack([across.ravel(), down.ravel(), np.ones(across.size)], axis=1)[traversal.order]
    columns = np.rint(1000 * sheet @ random.normal(size=(3, 12))).astype(np.int64)
    predictor = FittedPredictor(traversal)
    for column in columns[:, :-1].T:
        predictor.learn(column)
    known = np.diff(traversal.starts) > 0
    column = columns[:, -1]
    fitted, parallelograms = predictor.residuals(column), traversal.residuals(columns)[:, -1]
    assert np.abs(fitted[known]).mean() < 0.5 * np.abs(parallelograms[known]).mean()
    assert np.array_equal(predictor.restored(fitted), column)


def test_weights_are_found_where_neighbours_are_large_and_alike() -> None:
    traversal = traverse(SHEET)
    columns = np.full((traversal.order.size, 2), 10**9)
    columns[-1] += 1
    predictor = FittedPredictor(traversal)
    predictor.learn(columns[:, 0])
    assert np.isfinite(predictor.weights()).all()
    written = encode_fitted(columns, traversal)
    assert np.array_equal(decode_fitted(written, columns.shape[1], traversal), columns)


def test_each_column_takes_the_difference_that_suits_it() -> None:
    frames = np.arange(400)
    noisy = np.random.default_rng(0).integers(-9, 9, 400)
    assert len(encode_over_time(np.stack([50 * frames, 20 * frames**2], axis=1))) < 120
    alone, together = (encode_over_time(np.stack(each, axis=1)) for each in ([noisy], [noisy, 50 * frames]))
    assert len(together) < len(alone) + 60


@pytest.mark.parametrize("shape", [(40, 9), (9, 40), (12, 12)])
def test_principal_components_give_the_matrix_back_with_orthonormal_bases(shape: tuple[int, int]) -> None:
    rows = np.random.default_rng(0).normal(size=shape)
    mean, basis, coefficients = principal_components(rows)
    rank = basis.shape[1]
    assert rank == min(shape[0] - 1, shape[1])
    np.testing.assert_allclose(mean + coefficients @ basis.T, rows, atol=1e-7)
    np.testing.assert_allclose(basis.T @ basis, np.eye(rank), atol=1e-6)
    lengths = np.linalg.norm(coefficients, axis=0)
    assert (np.diff(lengths) <= 0).all()
    np.testing.assert_allclose(lengths[0], np.linalg.svd(rows - rows.mean(axis=0), compute_uv=False)[0])
