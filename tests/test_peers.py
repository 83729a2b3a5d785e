"""Peers keep the bound they are asked for, on bytes that they decoded again; and what they are made of is exact."""

from __future__ import annotations

import importlib.util
import inspect
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import connectivities, connectivity_of, grid
from numpy.typing import NDArray

from pdecodec.errors import MissingExtraError
from pdecodec.kernels.rangecoder import COUNT_MASK, ENCODE, EVEN, code_bit, finish, new_coder
from pdecodec.metrics import frame_scale
from pdecodec.peers.bspline import BSpline
from pdecodec.peers.catalogue import all_peers, available_peers
from pdecodec.peers.coddyac import Coddyac
from pdecodec.peers.corrected import Corrected
from pdecodec.peers.cosine import CosineInTime
from pdecodec.peers.delta import QuantiseDelta
from pdecodec.peers.draco import Draco
from pdecodec.peers.grid import Grid
from pdecodec.peers.lorenzo import Lorenzo
from pdecodec.peers.meshopt import Meshopt
from pdecodec.peers.peer import Encoder, Peer, UnreachableError
from pdecodec.peers.prediction import (
    cheapest_columns,
    cheapest_columns_reference,
    decode_over_mesh,
    decode_over_time,
    encode_over_mesh,
    encode_over_time,
)
from pdecodec.peers.principal import factor_steps, principal_components, quantise_columns
from pdecodec.peers.raw import RawFloat16, RawFloat32
from pdecodec.peers.search import CLOSE_ENOUGH, MOST_TRIES, PeerCurve, measure_peer
from pdecodec.peers.shapes import PrincipalShapes
from pdecodec.peers.shuffle import LARGE, level_for, narrowest, squeeze, unsqueeze
from pdecodec.peers.symbols import CELLS, TRUSTED, code_bands_reference, decode_bands, encode_bands
from pdecodec.peers.transform import Transform
from pdecodec.peers.traversal import (
    add_predictions,
    add_predictions_reference,
    fans,
    predictions,
    predictions_reference,
    traverse,
)
from pdecodec.peers.zfp import Zfp
from pdecodec.sequence import Connectivity, Float32Array

Int64Array = NDArray[np.int64]

ROWS, COLUMNS, FRAMES = 6, 20, 12


def wave(frames: int = FRAMES, rows: int = ROWS, columns: int = COLUMNS) -> Float32Array:
    """A sheet that waves and drifts, as many vertices as ``grid(rows, columns)``."""
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


def here(peer: Peer) -> Peer:
    """The peer, or a skip that says what is missing."""
    reason = peer.missing()
    if reason is not None:
        pytest.skip(reason)
    return peer


def largest_distance(points: Float32Array, decoded: Float32Array) -> float:
    return float(np.sqrt(((points.astype(np.float64) - decoded) ** 2).sum(axis=2)).max())


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("peer", all_peers(), ids=lambda peer: peer.name)
def test_every_peer_keeps_the_bound_on_what_it_decodes_or_says_why_not(peer: Peer, case: str) -> None:
    here(peer)
    connectivity, points = CASES[case]
    bound = 2e-2
    if (peer.name, case) == ("float16 + zstd", "far from the origin"):
        with pytest.raises(UnreachableError, match=r"its error is .* where 0\.02 is allowed"):
            measure_peer(peer, points, connectivity, bound=bound)
        return
    result = measure_peer(peer, points, connectivity, bound=bound)
    data = peer.prepare(points, connectivity)(result.length)
    decoded = peer.decode(data, connectivity)
    assert decoded.shape == points.shape
    assert len(data) == result.size
    assert largest_distance(points, decoded) == pytest.approx(result.distortion.max_error, abs=1e-15)
    assert result.distortion.max_error <= bound


EXTREMES = {
    **CASES,
    "very large": (grid(3, 4), 1e6 * noise(4, 12, 3)),
    "very small": (grid(3, 4), 1e-6 * noise(4, 12, 3)),
    "very far from the origin": (grid(3, 4), 1e6 + noise(4, 12, 3)),
    "a frame far from the others": (grid(3, 4), noise(4, 12, 3) * np.array([1, 1, 1e9, 1], np.float32)[:, None, None]),
    "all at the origin": (grid(3, 4), np.zeros((4, 12, 3), np.float32)),
}


@pytest.mark.parametrize("case", EXTREMES)
@pytest.mark.parametrize("peer", all_peers(), ids=lambda peer: peer.name)
def test_every_peer_keeps_a_tolerance_or_refuses_it_by_name_whatever_the_coordinates(peer: Peer, case: str) -> None:
    connectivity, points = EXTREMES[case]
    curve, scale = PeerCurve(here(peer), points, connectivity), frame_scale(points[0])
    for tolerance in (1e-1, 1e-4, 1e-9, 0.0):
        refusal = ""
        try:
            result = curve.reach(tolerance * scale)
        except UnreachableError as error:
            refusal = str(error)
        if refusal:
            assert re.match(
                rf"{re.escape(peer.name)}: .*(is .* allowed|are more than|need more than|beyond its|off where)", refusal
            )
            assert tolerance < 1e-1 or isinstance(peer, RawFloat16) or case == "a frame far from the others"
        else:
            assert result.distortion.max_error <= tolerance * scale
            decoded = peer.decode(peer.prepare(points, connectivity)(result.length), connectivity)
            assert largest_distance(points, decoded) == pytest.approx(result.distortion.max_error, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("peer", [peer for peer in all_peers() if peer.adjustable], ids=lambda peer: peer.name)
def test_a_tighter_bound_takes_more_bytes(peer: Peer) -> None:
    here(peer)
    sizes = [measure_peer(peer, wave(), SHEET, bound=bound).size for bound in (5e-2, 5e-3, 5e-4)]
    assert sizes[0] < sizes[1] < sizes[2]


@pytest.mark.parametrize("peer", all_peers(), ids=lambda peer: peer.name)
def test_the_same_input_gives_the_same_bytes(peer: Peer) -> None:
    here(peer)
    first, second = (peer.prepare(wave(), SHEET)(1e-3) for _ in range(2))
    assert first == second


@pytest.mark.parametrize("peer", [PrincipalShapes(), Coddyac()], ids=lambda peer: peer.name)
def test_motion_of_one_degree_of_freedom_costs_a_component_whatever_the_frames(peer: Peer) -> None:
    shape = wave()[0]
    sizes = []
    for frames in (20, 80):
        along = np.sin(np.linspace(0, 3, frames))[:, None, None] * noise(1, len(shape), 3, seed=1)
        sizes.append(measure_peer(peer, (shape + along).astype(np.float32), SHEET, bound=1e-2).size)
    assert sizes[1] < 1.5 * sizes[0]  # four times the frames: the shape stays, its weights are smooth


@pytest.mark.parametrize("peer", [CosineInTime(), PrincipalShapes(), Coddyac()], ids=lambda peer: peer.name)
def test_a_static_sequence_costs_little_more_than_its_first_frame(peer: Peer) -> None:
    still = np.repeat(noise(1, SHEET.vertex_count, 3), 50, axis=0)
    one = measure_peer(QuantiseDelta(), still[:1], SHEET, bound=1e-2).size
    assert measure_peer(peer, still, SHEET, bound=1e-2).size < 1.3 * one


def test_float32_comes_back_to_the_bit_and_float16_rounded() -> None:
    points = noise(3, 7, 3)
    for peer, expected in ((RawFloat32(), points), (RawFloat16(), points.astype(np.float16).astype(np.float32))):
        decoded = peer.decode(peer.prepare(points, Connectivity(7))(1.0), Connectivity(7))
        assert np.array_equal(decoded, expected)


def test_float16_refuses_coordinates_beyond_its_numbers() -> None:
    with pytest.raises(UnreachableError, match=r"1e\+05 is beyond"):
        RawFloat16().prepare(np.full((1, 1, 3), 1e5, np.float32), Connectivity(1))(1.0)


def test_meshopt_refuses_what_needs_more_than_16_bits() -> None:
    with pytest.raises(UnreachableError, match="16 bits"):
        here(Meshopt()).prepare(noise(3, 7, 3), Connectivity(7))(1e-5)


@pytest.mark.parametrize("peer", [QuantiseDelta(), Draco()], ids=lambda peer: peer.name)
def test_steps_too_fine_for_the_grid_are_refused(peer: Peer) -> None:
    with pytest.raises(UnreachableError, match="31 bits"):
        here(peer).prepare(noise(3, 7, 3), Connectivity(7))(1e-12)


def test_second_differences_win_for_the_lorenzo_predictor_where_motion_is_uniform() -> None:
    steps = np.arange(30.0)[:, None, None]
    uniform = (wave()[0] + steps * noise(1, SHEET.vertex_count, 3, seed=2)).astype(np.float32)
    erratic = (wave()[0] + noise(30, SHEET.vertex_count, 3)).astype(np.float32)
    orders = []
    for points in (uniform, erratic):
        data = Lorenzo().prepare(points, SHEET)(1e-3)
        orders.append(data[32 + 8])  # after the grid and the number of frames
    assert orders == [2, 1]


def test_draco_gives_vertices_back_in_their_order() -> None:
    points = wave()
    decoded = here(Draco()).decode(Draco().prepare(points, SHEET)(1e-4), SHEET)
    assert largest_distance(points, decoded) <= 1e-4


def test_draco_keeps_vertices_that_stand_in_one_place() -> None:
    sheet, points = grid(3, 4), noise(3, 12, 3)
    points[1:, 7] = points[1:, 2]
    decoded = here(Draco()).decode(Draco().prepare(points, sheet)(1e-4), sheet)
    assert largest_distance(points, decoded) <= 1e-4


def test_a_cubic_curve_that_moves_uniformly_needs_four_control_points_at_every_second_frame() -> None:
    u, t = np.linspace(-1, 1, 64), np.arange(9.0)[:, None, None]
    points = (np.stack([u, u**2, u**3], axis=-1) + t * [1.0, 0.0, 0.5]).astype(np.float32)
    data = BSpline().prepare(points, connectivity_of(64, lines=[range(64)]))(1e-4)
    frames, keys, controls, interval = struct.unpack_from("<3QB", data, 8)
    assert (frames, keys, controls, interval) == (9, 5, 4, 2)


def test_b_splines_with_a_control_point_for_every_point_pass_through_them() -> None:
    points = noise(4, 300, 3)
    result = measure_peer(BSpline(), points, connectivity_of(300, lines=[range(300)]), bound=1e-5)
    assert result.distortion.max_error <= 1e-5


def test_corrections_touch_only_what_the_transform_leaves_beyond_the_bound() -> None:
    points, bound = wave(), 1e-2
    transform = CosineInTime()
    peer = Corrected(transform)
    data = peer.prepare(points, SHEET)(bound)
    inner = data[16 : 16 + int.from_bytes(data[8:16], "little")]
    plain, corrected = transform.decode(inner, SHEET), peer.decode(data, SHEET)
    missed = np.sqrt(((points.astype(np.float64) - plain) ** 2).sum(axis=2)) > bound
    changed = (plain != corrected).any(axis=2)
    assert 0 < missed.sum() < missed.size / 4
    assert np.array_equal(changed, missed)
    assert largest_distance(points, corrected) <= bound


class Rounding(Peer):
    """Rounds to multiples of the length; its bytes say so."""

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
    points, peer = noise(1, 1000, 3), Rounding()
    result = measure_peer(peer, points, Connectivity(1000), bound=0.01)
    assert 0.9 * 0.01 < result.distortion.max_error <= 0.01
    assert len(peer.lengths) <= MOST_TRIES / 2
    assert result.length in peer.lengths


def test_the_search_names_the_reason_where_no_length_is_fine_enough() -> None:
    with pytest.raises(UnreachableError, match=r"rounding: no finer than 0\.1"):
        measure_peer(Rounding(floor=0.1), noise(1, 1000, 3), Connectivity(1000), bound=0.001)


def test_a_length_that_cannot_be_encoded_does_not_lose_what_was_found() -> None:
    class Ceiling(Rounding):
        """Refuses anything coarser than what it is asked for first."""

        def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
            encode = super().prepare(points, connectivity)

            def limited(length: float) -> bytes:
                if self.lengths:
                    raise UnreachableError("no coarser than this")
                return encode(length)

            return limited

    result = measure_peer(Ceiling(), noise(1, 1000, 3), Connectivity(1000), bound=0.1)
    assert result.length == 0.1


def test_a_peer_without_a_length_is_encoded_once_for_all_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    prepared = []
    prepare = RawFloat32.prepare
    monkeypatch.setattr(RawFloat32, "prepare", lambda *given: prepared.append(given) or prepare(*given))
    curve = PeerCurve(RawFloat32(), wave(), SHEET)
    assert len(prepared) == 0
    first, second = curve.reach(1e-3), curve.reach(1e-5)
    assert first is second
    assert (len(prepared), len(curve.tries), first.distortion.max_error) == (1, 1, 0.0)


def test_what_was_tried_for_one_bound_serves_the_others() -> None:
    points, peer, bounds = noise(1, 1000, 3), Rounding(), (0.1, 0.03, 0.01, 0.003, 0.001)
    curve = PeerCurve(peer, points, Connectivity(1000))
    results = [curve.reach(bound) for bound in bounds]
    assert len(peer.lengths) == len(curve.tries) <= 3 * len(bounds)
    for result, bound in zip(results, bounds, strict=True):
        assert 0.8 * bound <= result.distortion.max_error <= bound
        assert curve.reach(bound).size <= result.size
        assert result in curve.tries
    assert len(peer.lengths) == len(curve.tries)
    assert [made.length for made in curve.tries] == sorted(peer.lengths)


def test_bounds_in_another_order_give_nearly_the_same_bytes() -> None:
    bounds = (0.1, 0.01, 0.001)
    up, down = (PeerCurve(Rounding(), noise(1, 1000, 3), Connectivity(1000)) for _ in range(2))
    sizes = {bound: up.reach(bound).size for bound in reversed(bounds)}
    for bound in bounds:
        assert down.reach(bound).size == pytest.approx(sizes[bound], rel=1.1 * (1.0 - CLOSE_ENOUGH))


def test_of_what_a_search_for_a_transform_tries_only_the_end_is_coded(monkeypatch: pytest.MonkeyPatch) -> None:
    written = []
    write = CosineInTime.write
    monkeypatch.setattr(CosineInTime, "write", lambda *given: written.append(given) or write(*given))
    curve = PeerCurve(CosineInTime(), wave(), SHEET)
    sizes = [curve.reach(bound).size for bound in (1e-2, 1e-3, 1e-4)]
    assert sizes == [made.size for made in reversed(curve.tries)]
    assert len(written) == 3


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("peer", [BSpline(), CosineInTime(), PrincipalShapes(), Coddyac()], ids=lambda peer: peer.name)
def test_a_transform_gives_the_levels_it_wrote_and_positions_of_them_to_the_bit(
    peer: Transform[object], case: str
) -> None:
    connectivity, points = CASES[case]
    levels = peer.analyse(points, connectivity)(1e-2)
    again = peer.read(peer.write(levels, connectivity), connectivity)
    for name, expected in vars(levels).items():
        assert np.array_equal(getattr(again, name), expected)
    assert np.array_equal(peer.synthesise(again, connectivity), peer.synthesise(levels, connectivity))


def test_zfp_sees_only_powers_of_two() -> None:
    encode = here(Zfp()).prepare(wave(), SHEET)
    for length in (1e-3, 0.25, 0.3, 0.499, 3e5):
        least = Zfp().effective_length(length)
        assert 0.5 * length < least <= length
        assert encode(least) == encode(length) == encode(np.nextafter(2.0 * least, 0.0))
        assert encode(2.0 * least) != encode(least)


def test_the_coarsest_power_of_two_that_keeps_the_bound_is_found_for_zfp() -> None:
    encode, decode = here(Zfp()).prepare(wave(), SHEET), Zfp().decode
    curve = PeerCurve(Zfp(), wave(), SHEET)
    lengths = [2.0**power for power in range(-20, 4)]
    errors = [largest_distance(wave(), decode(encode(length), SHEET)) for length in lengths]
    for bound in (1e-1, 1e-4, 7e-3, 1.7e-3, 4e-4):
        expected = max(length for length, error in zip(lengths, errors, strict=True) if error <= bound)
        assert curve.reach(bound).length == expected


def test_much_data_takes_a_lower_level() -> None:
    assert [level_for(size) for size in (0, LARGE - 1, LARGE)] == [19, 19, 17]
    values = np.random.default_rng(0).integers(-3, 4, (30, 50))
    strong, light = squeeze(values), squeeze(values, level=1)
    assert len(strong) < len(light)
    assert np.array_equal(unsqueeze(light, values.dtype, values.shape), values)


def test_a_missing_package_is_named_with_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    able, reasons = available_peers()
    assert {peer.package for peer in able} == {None}
    assert [reason.split()[0] for reason in reasons] == ["meshopt", "Draco", "zfp", "SZ3"]
    with pytest.raises(MissingExtraError, match=r"Draco a frame needs the package DracoPy: pip install 'pdecodec"):
        measure_peer(Draco(), wave(), SHEET, bound=1e-3)


def test_peers_have_names_and_versions_of_their_own() -> None:
    able, _ = available_peers()
    assert len({peer.name for peer in all_peers()}) == len(all_peers())
    assert len({peer.version() for peer in able}) == len(able)
    assert {peer.name for peer in all_peers() if not peer.published} == {
        f"{peer.name}, corrected" for peer in (CosineInTime(), PrincipalShapes(), Coddyac())
    }


def test_a_version_follows_the_code_and_not_its_comments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, versions = tmp_path / "rounding.py", []
    monkeypatch.setattr(inspect, "getfile", lambda _: module)
    for text in ("a = 1", '"""Text."""\n\na = 1  # why', "a = 2"):
        module.write_text(text)
        versions.append(Rounding().version())
    assert versions[0] == versions[1] != versions[2]


integers = st.integers(-(2**40), 2**40) | st.integers(-3, 3)


@settings(deadline=None)
@given(st.lists(st.lists(integers, min_size=3, max_size=3), max_size=6))
def test_bands_of_any_integers_come_back(bands: list[list[int]]) -> None:
    values = np.array(bands, np.int64).reshape(len(bands), 3)
    assert np.array_equal(decode_bands(encode_bands(values), *values.shape), values)


def test_the_largest_magnitudes_come_back() -> None:
    values = np.array([[2**62 - 1, -(2**62 - 1), 0, 1, -1, 2**61]])
    assert np.array_equal(decode_bands(encode_bands(values), 1, 6), values)


def test_coded_bands_equal_their_plain_form() -> None:
    random = np.random.default_rng(0)
    values = np.rint(random.laplace(size=(4, 50)) * 10.0 ** np.arange(4)[:, None]).astype(np.int64)
    coder, data, cells = new_coder(ENCODE), np.zeros(10_000, np.uint8), np.full(CELLS, EVEN)

    def code(cell: int, bit: int) -> int:
        if cell < 0:
            cells[:] -= np.maximum(0, (cells & COUNT_MASK) - TRUSTED)
            return 0
        return int(code_bit(coder, data, cells, cell, bit))

    code_bands_reference(code, values)
    assert encode_bands(values) == data[: finish(coder, data)].tobytes()


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
def test_a_traversal_has_every_vertex_once_and_predicts_from_what_came_before(connectivity: Connectivity) -> None:
    traversal = traverse(connectivity)
    assert np.array_equal(np.sort(traversal.order), np.arange(connectivity.vertex_count))
    owner = np.repeat(np.arange(traversal.order.size), np.diff(traversal.starts))
    assert (traversal.corners < owner[:, None]).all()
    values = np.random.default_rng(0).integers(-1000, 1000, (connectivity.vertex_count, 2))
    assert np.array_equal(traversal.restored(values - traversal.predicted(values)), values)


def test_parallelograms_predict_a_flat_even_sheet_exactly() -> None:
    traversal = traverse(SHEET)
    row, column = np.divmod(traversal.order, COLUMNS)
    values = np.stack([7 * row - 3 * column, column], axis=1)
    known = np.diff(traversal.starts) > 0
    assert known.sum() == SHEET.vertex_count - 3  # all but the first triangle
    assert np.array_equal(traversal.predicted(values)[known], values[known])


def test_parts_of_a_mesh_are_traversed_one_after_the_other() -> None:
    both = connectivity_of(8, [[0, 2, 4, 6], [1, 3, 5, 7]])
    assert traverse(both).order.tolist() == [0, 2, 4, 6, 1, 3, 5, 7]


def test_polygons_become_fans() -> None:
    assert fans(connectivity_of(6, [[5, 4, 3, 2], [0, 1, 2]])).tolist() == [[5, 4, 3], [5, 3, 2], [0, 1, 2]]


def test_added_predictions_equal_their_plain_form() -> None:
    traversal = traverse(SHEET)
    residuals = np.random.default_rng(0).integers(-50, 50, (SHEET.vertex_count, 3))
    compiled, plain = residuals.copy(), residuals.copy()
    add_predictions(compiled, traversal.starts, traversal.corners)
    add_predictions_reference(plain, traversal.starts, traversal.corners)
    assert np.array_equal(compiled, plain)


@settings(deadline=None)
@given(connectivities(), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_predictions_equal_their_plain_form(connectivity: Connectivity, columns: int, seed: int) -> None:
    traversal = traverse(connectivity)
    values = np.random.default_rng(seed).integers(-50, 50, (connectivity.vertex_count, columns))
    compiled, plain = (
        form(values, traversal.starts, traversal.corners) for form in (predictions, predictions_reference)
    )
    assert np.array_equal(compiled, plain)


@pytest.mark.parametrize("shape", [(40, 7), (1, 5), (6, 0)])
def test_the_cheapest_columns_equal_their_plain_form(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(0)
    candidates = tuple(
        np.rint(random.laplace(size=shape) * 10.0 ** random.integers(0, 3, shape[1])).astype(np.int64) for _ in range(3)
    )
    (kind, bands), (plain_kind, plain_bands) = cheapest_columns(candidates), cheapest_columns_reference(candidates)
    assert np.array_equal(kind, plain_kind)
    assert np.array_equal(bands, plain_bands)


@settings(deadline=None)
@given(connectivities(), st.integers(0, 4), st.integers(0, 2**32 - 1))
def test_columns_come_back_over_mesh_and_time(connectivity: Connectivity, columns: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    values = np.rint(random.laplace(size=(connectivity.vertex_count, columns)) * 30).astype(np.int64)
    traversal = traverse(connectivity)
    assert np.array_equal(decode_over_mesh(encode_over_mesh(values, traversal), columns, traversal), values)
    assert np.array_equal(decode_over_time(encode_over_time(values), columns, len(values)), values)


def test_each_column_takes_the_difference_that_suits_it() -> None:
    frames = np.arange(400)
    noisy = np.random.default_rng(0).integers(-9, 9, 400)
    assert len(encode_over_time(np.stack([50 * frames, 20 * frames**2], axis=1))) < 120
    alone, together = (encode_over_time(np.stack(each, axis=1)) for each in ([noisy], [noisy, 50 * frames]))
    assert len(together) < len(alone) + 60


@pytest.mark.parametrize("shape", [(40, 9), (9, 40), (12, 12)])
def test_principal_components_give_the_matrix_back_with_orthonormal_bases(shape: tuple[int, int]) -> None:
    rows = np.random.default_rng(0).normal(size=shape)
    parts = principal_components(rows)
    rank = parts.basis.shape[1]
    assert rank == min(shape[0] - 1, shape[1])
    np.testing.assert_allclose(parts.mean + parts.coefficients @ parts.basis.T, rows, atol=1e-7)
    np.testing.assert_allclose(parts.basis.T @ parts.basis, np.eye(rank), atol=1e-6)
    lengths = np.linalg.norm(parts.coefficients, axis=0)
    assert (np.diff(lengths) <= 0).all()
    np.testing.assert_allclose(lengths[0], np.linalg.svd(rows - rows.mean(axis=0), compute_uv=False)[0])


def test_a_constant_matrix_has_no_components() -> None:
    assert principal_components(np.full((5, 7), 3.0)).basis.shape == (7, 0)


def test_columns_that_round_to_nothing_are_left_out() -> None:
    levels, used = quantise_columns(np.array([[3.0, 0.1, -0.9], [0.0, 0.4, 0.0]]), 1.0)
    assert (used.tolist(), levels.tolist()) == ([0, 2], [[3, -1], [0, 0]])
    assert factor_steps(100 * levels).tolist() == [0.25 / 300, 0.25 / 100]


@given(st.floats(1e-3, 1.0), st.integers(0, 2**32 - 1))
def test_the_nearest_grid_points_keep_the_bound(bound: float, seed: int) -> None:
    points = noise(2, 50, 3, seed=seed)
    grid_points = Grid.within(points, bound)
    assert largest_distance(points, grid_points.positions(grid_points.levels(points))) <= bound


@pytest.mark.parametrize(("largest", "bytes_each"), [(127, 1), (128, 2), (32768, 4), (2**31, 8)])
def test_integers_are_kept_in_the_fewest_bytes_and_come_back(largest: int, bytes_each: int) -> None:
    values = np.array([[0, -largest], [largest, 5]])
    narrow = narrowest(values)
    assert narrow.itemsize == bytes_each
    assert np.array_equal(unsqueeze(squeeze(narrow), narrow.dtype, narrow.shape), values)
