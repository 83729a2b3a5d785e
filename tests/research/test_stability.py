"""The stability atlas: its findings as facts, how the library deals with them, and the command that writes it."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from pdecodec.cli.main import pdecodec
from pdecodec.cli.research import SECTIONS as NAMED_SECTIONS
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EncodeSettings
from pdecodec.errors import SettingsError
from pdecodec.mesh.metrics import measure_distortion
from pdecodec.mesh.sequence import ArraySequence
from pdecodec.report.charts.figure import Figure, Report, Section, Table
from pdecodec.report.charts.page import as_csv, render_page, value_text, write_report
from pdecodec.report.charts.pictures import Picture, extent
from pdecodec.report.charts.plots import BLUE, Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import as_svg
from pdecodec.research.reproduction.functions import space_functions, time_functions
from pdecodec.research.reproduction.method import affine_between, rotation_between
from pdecodec.research.stability.alignment import STEADY_DEGREES, jitter, kabsch_plain, kabsch_proper, shape
from pdecodec.research.stability.atlas import SECTIONS, make_atlas
from pdecodec.research.stability.codec import encode_and_measure
from pdecodec.research.stability.extremes import (
    BALL_RADIUS,
    ITERATED,
    SMALL,
    SWEEP_PLANS,
    WHOLE,
    cloth_error,
    material_stretch,
    passes_through,
)
from pdecodec.research.stability.extremes import hanging_stretch as extreme_stretch
from pdecodec.research.stability.fit_data import noise_gain, spline_weights, time_weights
from pdecodec.research.stability.fit_rates import NAMES, WELL_CONDITIONED, exact_errors, relative_error, sample_fit
from pdecodec.research.stability.massspring import LITERAL, Chain, hanging_stretch, implicit_euler, largest_motion
from pdecodec.research.stability.nasty_clips import NASTY
from pdecodec.research.stability.parametrisation import curves, planar_figure
from pdecodec.research.stability.simulation import DIVERGED

# The fit


def test_the_condition_of_the_printed_functions_grows_by_three_powers_in_time_and_seven_in_space() -> None:
    x = np.linspace(0.0, 1.0, 60)
    for functions, power in ((time_functions, 3), (space_functions, 7)):
        conditions = [np.linalg.cond(functions(x, rate)) for rate in (0.4, 0.2)]
        assert np.log2(conditions[1] / conditions[0]) == pytest.approx(power, abs=0.15)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_only_the_well_conditioned_basis_finds_the_minimiser_at_small_rates(dtype: type) -> None:
    fit, wanted = sample_fit(60)
    exact = relative_error(fit.solve(WELL_CONDITIONED, wanted, 1e-4, 1e-4, np.float64), wanted)
    for name in NAMES:
        error = relative_error(fit.solve(name, wanted, 1e-4, 1e-4, dtype), wanted)
        assert (error < 1.01 * exact) == (name == WELL_CONDITIONED), name


def test_the_well_conditioned_basis_leaves_the_exact_minimisers_error_at_any_rate() -> None:
    fit, wanted = sample_fit(40)
    rates = np.array([1e-6, 1e-2, 2.0, 15.0])
    exact = exact_errors(fit, wanted, rates)
    found = [
        [relative_error(fit.solve(WELL_CONDITIONED, wanted, alpha, r, np.float64), wanted) for r in rates]
        for alpha in rates
    ]
    np.testing.assert_allclose(found, exact, rtol=1e-6)


def test_all_solvers_agree_at_moderate_rates() -> None:
    fit, wanted = sample_fit(60)
    found = {name: fit.solve(name, wanted, 3.0, 3.0, np.float64) for name in NAMES}
    for name in ("normal equations", "QR", "SVD"):
        np.testing.assert_allclose(found[name], found[WELL_CONDITIONED], atol=1e-4)


def test_a_fit_of_four_functions_passes_on_less_noise_than_a_spline_through_the_frames() -> None:
    keyframes, dense = np.linspace(0, 1, 8), np.linspace(0, 1, 101)
    fitted, spline = noise_gain(time_weights(keyframes, dense, 2.0)), noise_gain(spline_weights(keyframes, dense))
    assert fitted.max() < 1.0 < spline.max()
    np.testing.assert_allclose(noise_gain(spline_weights(keyframes, keyframes)), 1.0, atol=1e-12)


# The parametrisation


def test_the_library_encodes_every_curve_on_which_the_papers_parameter_breaks() -> None:
    for name, curve in curves(60).items():
        time = np.arange(8) / 24
        points = (curve[None] + 0.05 * np.sin(3 * curve[None, :, :1] + 5 * time[:, None, None])).astype(np.float32)
        clip = ArraySequence(points, times=time)
        report = encode(clip, tolerance=1e-3)
        with open_animation(report.data or b"") as animation:
            found = measure_distortion(clip, animation.to_array())
        assert found.max_error <= 1e-3 * found.scale, name


def test_on_a_planar_curve_the_papers_parameter_is_rounding() -> None:
    table = planar_figure(7).table
    thickness, literal = np.array(table.column("thickness")), np.array(table.column("Eq. 24, float32"))
    assert literal[thickness > 0.1].max() < 1e-4
    assert literal[thickness < 1e-8].min() > 0.1
    assert max(float(value or 0) for value in table.column("arc length, float32")) < 1e-5


# The alignment


def test_the_librarys_rotation_is_proper_and_steady_on_every_curve() -> None:
    mirror = np.diag([1.0, 1.0, -1.0])
    for kind in ("general", "planar", "straight", "circle"):
        for matrix in (np.eye(3), mirror):
            target = shape(kind)
            assert np.linalg.det(rotation_between(target @ matrix, target)) == pytest.approx(1.0)
            assert jitter(rotation_between, target @ matrix, target) < STEADY_DEGREES


def test_without_care_a_straight_curve_spins_and_a_mirrored_one_is_mirrored() -> None:
    straight, general = shape("straight"), shape("general")
    assert jitter(kabsch_proper, straight, straight) > 10
    assert np.linalg.det(kabsch_plain(general @ np.diag([1.0, 1.0, -1.0]), general)) == pytest.approx(-1.0)
    assert abs(np.linalg.det(affine_between(straight, straight))) < 1e-9


# The simulation


def test_symplectic_euler_diverges_at_two_over_the_highest_frequency() -> None:
    chain = Chain()
    limit = 2 / chain.highest_frequency
    assert largest_motion("symplectic Euler", chain, 0.95 * limit, 300) < DIVERGED
    assert largest_motion("symplectic Euler", chain, 1.1 * limit, 300) > DIVERGED
    for method in ("implicit Euler", "XPBD", "PBD"):
        assert largest_motion(method, chain, 10 * limit, 30) < DIVERGED


def test_explicit_euler_gains_energy_at_any_step() -> None:
    chain = Chain()
    step = 0.3 / chain.highest_frequency
    assert largest_motion("explicit Euler", chain, step, 3000) > DIVERGED


def test_the_stiffness_of_xpbd_is_the_materials_and_that_of_pbd_grows_with_iterations() -> None:
    xpbd = [hanging_stretch(method="xpbd", iterations=n, substeps=2, seconds=3.0) for n in (4, 16)]
    np.testing.assert_allclose(xpbd, 1.0, atol=0.05)
    pbd = [hanging_stretch(method="pbd", iterations=n, substeps=2, stiffness=0.5, seconds=3.0) for n in (4, 16)]
    assert pbd[0] / pbd[1] == pytest.approx(4.0, rel=0.2)


def test_implicit_euler_falls_freely_when_nothing_pulls() -> None:
    chain = Chain(links=2, stiffness=1e-9)
    positions, velocities = implicit_euler(chain, chain.positions(), np.zeros((3, 3)), 0.1)
    np.testing.assert_allclose(velocities[1:, 1], -0.980665, rtol=1e-6)
    np.testing.assert_allclose(positions[0], 0.0)


def test_the_first_line_of_the_algorithm_with_the_constraints_own_forces_is_explicit_and_diverges() -> None:
    chain = Chain()
    step = 20 * 2 / chain.highest_frequency
    assert largest_motion("XPBD", chain, step, 60) < DIVERGED < largest_motion(LITERAL, chain, step, 60)


def test_a_chain_solved_as_a_whole_holds_any_weight_length_and_stiffness() -> None:
    whole = SWEEP_PLANS[WHOLE]
    assert extreme_stretch(whole, mass_ratio=1e6, seconds=1.0) < 1e-12
    assert extreme_stretch(whole, links=1000, seconds=0.5) < 1e-12
    for stiffness in (1e3, 1e7, 1e12):
        found = extreme_stretch(whole, stiffness=stiffness)
        assert found == pytest.approx(material_stretch(12, stiffness), rel=1e-4)


def test_small_steps_stretch_less_than_as_many_iterations_and_neither_runs_off() -> None:
    for case in ({"mass_ratio": 1e3}, {"links": 100}, {"stiffness": 1e6}):
        iterated, small = (extreme_stretch(SWEEP_PLANS[name], seconds=2.0, **case) for name in (ITERATED, SMALL))
        assert 0 < small < 0.5 * iterated < 10
    (_, spread), (_, piled) = cloth_error(9, 8, [(20, 1, "xpbd"), (1, 20, "xpbd")], 320)
    assert spread < 0.5 * piled


def test_particles_pass_through_a_ball_thinner_than_a_step_but_never_through_the_ground() -> None:
    assert passes_through(0.4 * BALL_RADIUS / 0.01, 0.01, through="ball") == 0.0
    assert passes_through(5.0 * BALL_RADIUS / 0.01, 0.01, through="ball") > 0.5
    assert all(passes_through(speed, 0.01, through="ground") == 0.0 for speed in (1.0, 100.0, 1e4))


# The codec


@pytest.mark.parametrize("name", NASTY)
def test_the_bound_holds_on_every_nasty_clip(name: str) -> None:
    clip = NASTY[name](10, 18)
    found = encode_and_measure(clip, EncodeSettings(tolerance=1e-3))
    assert found.error <= 1.0
    assert found.bits < 96


# The report


def test_the_command_knows_every_section() -> None:
    assert tuple(SECTIONS) == NAMED_SECTIONS


def test_an_unknown_section_is_refused_by_name() -> None:
    with pytest.raises(SettingsError, match="there is no section 'weather'"):
        make_atlas(["weather"])


def test_every_entry_has_its_chart_its_sentence_and_its_figures() -> None:
    atlas = make_atlas(quick=True)
    assert len(atlas.figures) >= 18
    for figure in atlas.figures:
        assert figure.lesson.endswith(".")
        assert figure.table.rows
        assert figure.chart is not None
        assert as_svg(figure.chart).count("role-mark") > 0


def test_one_section_alone_is_that_section(tmp_path: Path) -> None:
    arguments = ["stability", "-o", str(tmp_path), "--only", "parametrisation", "--quick", "--json"]
    result = CliRunner().invoke(pdecodec, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    names = {"parameter-cases", "parameter-planar"}
    assert set(json.loads(result.stdout)["figures"]) == {path.stem for path in tmp_path.glob("*.png")} == names
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    for name in names:
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert len((tmp_path / f"{name}.csv").read_text().splitlines()) > 1
        assert f'id="{name}"' in page
    assert page.count("<noscript><img") == len(names)


def test_a_table_of_sentences_names_its_columns_in_every_cell_for_narrow_screens() -> None:
    for text, named in (("word", False), (100 * "x", True)):
        figure = Figure("name", "t", "l", Table(('a "b"', "x"), ((text, 1.5), ("y", 2.0))), shows_table=True)
        page = render_page(Report("T", "", (Section("C", "", (figure,)),), {}), {}, {})
        assert page.count('data-name="a &quot;b&quot;"') == 2 * named
        assert ('class="words"' in page) == named


def test_pages_escape_what_they_are_given_and_say_what_is_not_a_number() -> None:
    table = Table(("a <b>", "x"), (("<script>", 1.5), ("&", None), ("nan", float("nan"))))
    report = Report(
        "T & U", "", (Section("C", "", (Figure("name", "t", "l", table, shows_table=True),)),), {"k": [1, 2]}
    )
    page = render_page(report, {}, {"pdecodec": "0"})
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "not finite" in page
    assert "T &amp; U" in page
    assert as_csv(table).splitlines() == ["a <b>,x", "<script>,1.5", "&,", "nan,nan"]


@pytest.mark.parametrize(
    ("cell", "text"),
    [(None, "-"), (True, "yes"), (12345, "12,345"), (0.00001234, "1.23e-05"), (0.5, "0.5"), ("x", "x")],
)
def test_values_are_written_for_people(cell: object, text: str) -> None:
    assert value_text(cell) == text  # type: ignore[arg-type]


def test_the_same_report_gives_the_same_bytes(tmp_path: Path) -> None:
    panel = Panel(Axis("x", 0, 2), Axis("y", 1e-3, 10, log=True))
    panel.fails("fails", above=1.0)
    panel.lines([0, 1, 2], {"a": ([1.0, 0.0, float("nan")], BLUE)})
    chart = side_by_side(panel)
    sheet = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])

    def picture() -> str:
        found = Picture(60, 60)
        found.view((5, 5, 50, 50), extent(sheet), "").mesh(
            sheet, [np.arange(4, dtype=np.int32)[None]], [np.ones((1, 3))]
        )
        return found.svg()

    table = Table(("a",), ((float("inf"),),))
    figures = (Figure("one", "t", "l", table, chart), Figure("two", "t", "l", table, picture=picture))
    report = Report("T", "s", (Section("C", "i", figures),), {})
    first, again = ({path.name: path.read_bytes() for path in write_report(report, tmp_path)} for _ in range(2))
    assert first == again
    assert set(first) == {"index.html", "one.png", "one.svg", "one.csv", "two.png", "two.csv", "report.json"}
    assert json.loads(first["report.json"])["figures"]["one"]["rows"] == [[None]]
    with Image.open(io.BytesIO(first["two.png"])) as drawn:
        assert drawn.size == (120, 120)
        # White outside the square; in its middle the square's own colour, shaded by the light.
        assert drawn.convert("RGB").getpixel((2, 2)) == (255, 255, 255)
        assert drawn.convert("L").getpixel((60, 60)) == pytest.approx(255 * (0.35 + 0.65 * 0.507), abs=2)
