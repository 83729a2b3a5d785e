"""`pdecodec demo`: simulate, encode, decode and measure the cube-rope; print tables and draw a picture."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import byte_size, outputs_written, print_json, print_table, progress_bar, put, ratio, say
from pdecodec.cli.options import json_option
from pdecodec.errors import MissingExtraError

if TYPE_CHECKING:
    from pdecodec.mesh.surface_metrics import SurfaceDistortion
    from pdecodec.report.demo import Demonstration, Encoding


@click.command()
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder for the picture and the .pdeanim files.")
@json_option
def demo(*, output: str, as_json: bool) -> None:
    """Simulate, encode, decode and measure the cube-rope.

    It is decoded at its frames and between them. Tables show sizes, errors and times; a picture is drawn if the extra
    `report` is installed. Files of an earlier demonstration in DIR are replaced.
    """
    say("simulating, encoding and decoding takes about half a minute")
    from pdecodec.report.demo import demonstrate, draw

    started = time.perf_counter()
    directory = Path(output)
    directory.mkdir(parents=True, exist_ok=True)
    with progress_bar() as progress:
        found = demonstrate(directory, progress=progress)
    picture = directory / "demo.png"
    try:
        draw(found, picture)
        drawn = f"picture: {picture}"
    except MissingExtraError as error:
        drawn = f"note: no picture was drawn: {error}"
    seconds = time.perf_counter() - started
    with outputs_written():
        if as_json:
            print_json(_as_json(found, seconds))
        else:
            _print(found)
    first = found.encodings[0]
    for encoding in found.encodings:
        say(f"{encoding.report.path}: {encoding.report.summary}")
    say(drawn)
    say(
        f"in {byte_size(first.report.raw_bytes)} -> out {byte_size(first.report.file_bytes)} "
        f"({ratio(first.report.raw_bytes, first.report.file_bytes)}), max error {first.distortion.max_error:.3g} "
        f"scene units (bound {first.report.bound:.3g}), {seconds:.1f} s for everything"
    )


def _print(found: Demonstration) -> None:
    """Print three tables: the encodings, the frames left out, and the bytes per section."""
    from pdecodec.codec.encode.report import SECTION_TITLES

    clip, each, between = found.sequence, found.encodings, found.between
    names = [encoding.name for encoding in each]
    rows: list[tuple[str, Callable[[Encoding], str]]] = [
        ("profile", lambda item: "paper" if item.report.bound is None else "auto, tolerance 0.001"),
        ("raw float32", lambda item: byte_size(item.report.raw_bytes)),
        ("file", lambda item: byte_size(item.report.file_bytes)),
        ("ratio", lambda item: ratio(item.report.raw_bytes, item.report.file_bytes)),
        ("bits per vertex and frame", lambda item: f"{item.bits:.3f}"),
        ("maximum error / diagonal", lambda item: f"{item.distortion.e_m:.6f}"),
        ("rms error / diagonal", lambda item: f"{item.distortion.rms_error / item.distortion.scale:.6f}"),
        ("E_A (Eq. 26)", lambda item: f"{item.distortion.e_a:.6f}"),
        ("E_M (Eq. 27)", lambda item: f"{item.distortion.e_m:.6f}"),
        ("KG error", lambda item: f"{item.distortion.kg_error:.4f} %"),
    ]
    print_table(
        ("", *names),
        [
            *((label, *map(write, each)) for label, write in rows),
            *_surface_rows([item.surface for item in each]),
            ("encode", *(f"{item.report.seconds:.2f} s" for item in each)),
            ("decode all frames", *(f"{item.decode_seconds:.2f} s" for item in each)),
        ],
        title=f"cube-rope: {clip.frame_count} frames of {clip.vertex_count:,} vertices, "
        f"simulated in {found.simulate_seconds:.1f} s",
    )
    put()
    pair = (between.decoded, between.linear)
    print_table(
        ("at the frames left out", "decoded", "straight lines"),
        [
            ("maximum error / diagonal", *(f"{item.e_m:.6f}" for item in pair)),
            ("rms error / diagonal", *(f"{item.rms_error / item.scale:.6f}" for item in pair)),
            ("KG error", *(f"{item.kg_error:.4f} %" for item in pair)),
            *_surface_rows([between.decoded_surface, between.linear_surface]),
        ],
        title="every second frame left out",
    )
    put()
    sections = dict.fromkeys(name for item in each for name in item.report.sections)
    print_table(
        ("bytes", *names),
        [
            (SECTION_TITLES.get(name, name), *(f"{item.report.sections.get(name, 0):,}" for item in each))
            for name in sections
        ],
        title="by section",
    )
    put()


def _surface_rows(each: list[SurfaceDistortion]) -> list[tuple[str, ...]]:
    return [
        ("edge difference (STED)", *(f"{item.sted:.6f}" for item in each)),
        ("normals, mean angle", *(f"{item.normal_error:.3f} degrees" for item in each)),
        ("normals, 99 % within", *(f"{item.normal_p99:.3f} degrees" for item in each)),
    ]


def _as_json(found: Demonstration, seconds: float) -> dict[str, Any]:
    def encoding(item: Encoding) -> dict[str, Any]:
        return {
            "path": str(item.report.path),
            "raw_bytes": item.report.raw_bytes,
            "output_bytes": item.report.file_bytes,
            "sections": item.report.sections,
            "encode_seconds": item.report.seconds,
            "decode_seconds": item.decode_seconds,
            "distortion": {**item.distortion.to_dict(), **asdict(item.surface)},
        }

    return {
        "frames": found.sequence.frame_count,
        "vertices": found.sequence.vertex_count,
        "simulate_seconds": found.simulate_seconds,
        "encodings": {item.name: encoding(item) for item in found.encodings},
        "rates": [encoding(item) for item in found.rates],
        "between_frames": {
            "decoded": {**found.between.decoded.to_dict(), **asdict(found.between.decoded_surface)},
            "linear": {**found.between.linear.to_dict(), **asdict(found.between.linear_surface)},
        },
        "seconds": seconds,
    }
