"""`pdecodec compare`: measure the distance between two sequences, and whether they have the same mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import print_json, print_table, progress_bar, say, say_notices, say_rounding
from pdecodec.cli.options import assets_option, fps_option, fraction, json_option, within_limits
from pdecodec.errors import SettingsError

if TYPE_CHECKING:
    from pdecodec.mesh.sequence import MeshSequence

TIME_TOLERANCE = 1e-6
"""Largest difference of times that count as equal [s]: formats that count frames round times to the frame rate."""


@click.command()
@click.argument("reference", metavar="A")
@click.argument("other", metavar="B")
@click.option(
    "--tolerance",
    type=fraction,
    metavar="X|P%",
    help="Fail if the maximum error, relative to the diagonal, exceeds this.",
)
@click.option("--max-error", type=float, metavar="X", help="Fail if the maximum error exceeds this many scene units.")
@click.option(
    "--at-frames", is_flag=True, help="Evaluate B, which must be a .pdeanim file, at the times of A's frames."
)
@within_limits
@fps_option
@assets_option(expose_value=False)
@json_option
@click.pass_context
def compare(
    context: click.Context,
    *,
    reference: str,
    other: str,
    tolerance: float | None,
    max_error: float | None,
    at_frames: bool,
    fps: float | None,
    as_json: bool,
) -> None:
    """Measure the error of B against A.

    Frames and vertices are compared one by one, in order. Errors are Euclidean distances in scene units; relative
    errors are divided by the diagonal of the bounding box of A's frame 0. If A and B have the same faces and lines,
    edge lengths in space and time (a spatio-temporal edge difference after Vasa and Skala 2011) and normals are
    compared as well. The exit code is 1 if faces or counts differ, or if the error exceeds a limit given here.
    """
    from pdecodec.formats.base.choosing import InputOptions, open_clip, rate_to_assume
    from pdecodec.formats.base.transforms import bake_transforms
    from pdecodec.mesh.rounding import rounding_noticed

    for name, value in (("--tolerance", tolerance), ("--max-error", max_error)):
        if value is not None and not value >= 0:
            raise SettingsError(f"{name} must be zero or more, not {value}")
    asked = [InputOptions(fps=rate_to_assume(source, fps)) for source in (reference, other)]
    with open_clip(reference, asked[0]) as first, open_clip(other, asked[1]) as second:
        say_notices(first.notices)
        say_notices(second.notices)
        other_frames = _at_times_of(first, second) if at_frames else second
        # Transforms that either sequence keeps separately are part of its vertex positions.
        with rounding_noticed() as rounding:
            result = _compare(bake_transforms(first), bake_transforms(other_frames))
    if result["diagonal"] is not None:
        say_rounding(rounding.largest, result["diagonal"])
    failures = _failures(result, tolerance, max_error)
    if as_json:
        print_json({**result, "passed": not failures, "failures": failures})
    else:
        _print(result)
    for failure in failures:
        say(f"failed: {failure}")
    if failures:
        context.exit(1)


def _at_times_of(first: MeshSequence, second: MeshSequence) -> MeshSequence:
    from pdecodec.codec.decoder import Animation
    from pdecodec.codec.resampling import sampled

    if not isinstance(second, Animation):
        raise SettingsError("--at-frames evaluates B between its frames, so B must be a .pdeanim file")
    return sampled(second, first.times)


def _compare(first: MeshSequence, second: MeshSequence) -> dict[str, Any]:
    import numpy as np

    from pdecodec.mesh.metrics import Distortion, measure_distortion
    from pdecodec.mesh.surface_metrics import SurfaceDistortion, measure_surfaces

    result: dict[str, Any] = {
        "frames": [first.frame_count, second.frame_count],
        "vertices": [first.most_vertices, second.most_vertices],
        "connectivity_equal": _are_alike(first, second, lambda a, b: a.connectivity.same_as(b.connectivity)),
        "objects_equal": _are_alike(first, second, lambda a, b: _names(a) == _names(b)),
        "times_equal": first.frame_count == second.frame_count
        and bool(np.allclose(first.times, second.times, rtol=0.0, atol=TIME_TOLERANCE)),
    }
    measures: dict[str, Any] = dict.fromkeys(
        field.name for kind in (Distortion, SurfaceDistortion) for field in fields(kind)
    )
    if first.frame_count == second.frame_count and _are_alike(
        first, second, lambda a, b: a.vertex_count == b.vertex_count
    ):
        with progress_bar() as progress:
            measures |= measure_distortion(first, second, progress=progress).to_dict()
            if result["connectivity_equal"]:
                measures |= asdict(measure_surfaces(first, second, measures["scale"], progress))
    for left_out in ("frames", "vertices", "within"):
        del measures[left_out]
    return {**result, "diagonal": measures.pop("scale"), **measures}


def _failures(result: dict[str, Any], tolerance: float | None, max_error: float | None) -> list[str]:
    """Return the reasons why B does not pass, one per line; empty if it passes."""
    failures = [
        f"A has {result[counted][0]} {counted}, B has {result[counted][1]}"
        for counted in ("frames", "vertices")
        if result[counted][0] != result[counted][1]
    ]
    if not failures and not result["connectivity_equal"]:
        failures.append("faces or lines differ")
    if result["max_error"] is not None:
        if tolerance is not None and result["e_m"] > tolerance:
            failures.append(f"maximum error {result['e_m']:.6g} of the diagonal is above {tolerance:g}")
        if max_error is not None and result["max_error"] > max_error:
            failures.append(f"maximum error {result['max_error']:.6g} is above {max_error:g}")
    return failures


def _are_alike(first: MeshSequence, second: MeshSequence, test: Callable[[MeshSequence, MeshSequence], bool]) -> bool:
    """Return whether both sequences pass `test` at every frame where a run of either begins."""
    frames = sorted({*first.run_starts.tolist(), *second.run_starts.tolist()})
    return frames[-1] < min(first.frame_count, second.frame_count) and all(
        test(first.runs[first.run_number_of(frame)], second.runs[second.run_number_of(frame)]) for frame in frames
    )


def _names(sequence: MeshSequence) -> list[str]:
    return [item.name for item in sequence.objects]


def _print(result: dict[str, Any]) -> None:
    rows: list[tuple[str, ...]] = []
    if result["max_error"] is not None:
        for label, name in (("maximum error", "max_error"), ("99 % within", "p99_error"), ("rms error", "rms_error")):
            rows.append((label, f"{result[name]:.6g}", f"{result[name] / result['diagonal']:.6g}"))
        rows.append(("E_A (Eq. 26)", "", f"{result['e_a']:.6g}"))
        rows.append(("E_M (Eq. 27)", "", f"{result['e_m']:.6g}"))
        rows.append(("KG error", "infinite" if result["kg_error"] is None else f"{result['kg_error']:.6g} %"))
        if result["sted"] is not None:
            rows.append(("edge difference (STED)", "", f"{result['sted']:.6g}"))
        if result["normal_error"] is not None:
            degrees = f"{result['normal_error']:.4g} degrees, 99 % within {result['normal_p99']:.4g}"
            rows.append(("normals, mean angle", degrees))
        rows.append(("diagonal", f"{result['diagonal']:.6g}", "1"))
        rows.append(("worst at", f"frame {result['worst_frame']}, vertex {result['worst_vertex']}"))
    for label, name in (
        ("faces, lines, order", "connectivity_equal"),
        ("object names", "objects_equal"),
        ("times", "times_equal"),
    ):
        rows.append((label, "equal" if result[name] else "different"))
    print_table(("", "scene units", "of the diagonal"), rows)
