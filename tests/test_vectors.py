"""The vectors of the specification: accepted ones decode to the pinned bits, refused ones to the pinned error."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import CorruptFileError, LimitError, corrections, curves, decoder, description, elements, open_animation
from pdecodec import connectivity_version_1 as version_1
from pdecodec import connectivity_version_2 as version_2
from pdecodec.basis import MAX_RATE, SERIES_TERMS
from pdecodec.kernels.orthonormal import DEPENDENT
from pdecodec.quantise import LARGEST, LARGEST_STEP
from pdecodec.segments import DEPENDENT_IN_TIME, MAX_EXPONENT
from pdecodec.sequence import LARGEST_TIME, SHORTEST_TIME_STEP
from pdecodec.settings import MAX_SEGMENT_FRAMES
from spec.decoder import animation as independent
from spec.decoder.fields import CorruptFileError as IndependentCorruptFileError
from spec.decoder.fields import unpack_integers
from spec.sealing import compressed, varints

SPEC = Path(__file__).resolve().parent.parent / "spec"
VECTORS = SPEC / "vectors"
MANIFEST: dict[str, dict[str, dict[str, Any]]] = json.loads((VECTORS / "manifest.json").read_text("utf-8"))


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@pytest.mark.parametrize("folder", ["accept", "reject"])
def test_the_manifest_lists_every_vector_and_its_bytes_have_not_changed(folder: str) -> None:
    files = {path.stem: path for path in (VECTORS / folder).iterdir()}
    assert files.keys() == MANIFEST[folder].keys()
    assert len(files) >= 20
    for name, path in files.items():
        assert path.suffix == ".pdeanim"
        assert sha256(path.read_bytes()) == MANIFEST[folder][name]["sha256"], name


def test_the_vectors_stay_small() -> None:
    sizes = [path.stat().st_size for path in VECTORS.rglob("*.pdeanim")]
    assert max(sizes) < 16_000
    assert sum(sizes) < 400_000


@pytest.mark.parametrize("name", MANIFEST["accept"])
def test_an_accepted_vector_decodes_to_the_pinned_bits(name: str) -> None:
    expected = MANIFEST["accept"][name]
    with open_animation(VECTORS / "accept" / f"{name}.pdeanim") as animation:
        animation.verify()
        part = animation.connectivity
        assert [item.name for item in animation.objects] == expected["objects"]
        assert (animation.vertex_count, animation.frame_count) == (expected["vertices"], expected["frames"])
        assert (part.face_count, part.line_count) == (expected["faces"], expected["lines"])
        for times, pinned in (
            (animation.times, expected["positions"]),
            (expected["between"], expected["positions_between"]),
        ):
            assert sha256(animation.sample(times).astype("<f4").tobytes()) == pinned


@pytest.mark.parametrize("name", MANIFEST["accept"])
def test_the_independent_decoder_gives_the_pinned_bits_too(name: str) -> None:
    expected = MANIFEST["accept"][name]
    animation = independent.decode_file(VECTORS / "accept" / f"{name}.pdeanim")
    assert [mesh.name for mesh in animation.meshes] == expected["objects"]
    for times, pinned in (
        (animation.times, expected["positions"]),
        (expected["between"], expected["positions_between"]),
    ):
        points = np.stack([animation.positions(time) for time in times])
        assert sha256(points.astype("<f4").tobytes()) == pinned


@pytest.mark.parametrize("name", MANIFEST["reject"])
def test_a_refused_vector_ends_in_the_pinned_error(name: str) -> None:
    expected = MANIFEST["reject"][name]
    path = VECTORS / "reject" / f"{name}.pdeanim"

    def decode_all() -> None:
        with open_animation(path) as animation:
            animation.sample(animation.times)

    with pytest.raises(CorruptFileError) as caught:
        decode_all()
    assert (type(caught.value) is LimitError) == (expected["error"] == "limit")
    assert caught.value.exit_code == expected["exit_code"]
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("name", [name for name, vector in MANIFEST["reject"].items() if vector["error"] == "corrupt"])
def test_the_independent_decoder_refuses_what_is_corrupt(name: str) -> None:
    def decode_all() -> None:
        animation = independent.decode_file(VECTORS / "reject" / f"{name}.pdeanim")
        for time in animation.times:
            animation.positions(time)

    with pytest.raises(IndependentCorruptFileError):
        decode_all()


def test_the_examples_of_the_specification_hold() -> None:
    text = (SPEC / "pdeanim.md").read_text("utf-8")
    examples = re.findall(r"^\| (-?\d+) \| `([0-9A-F ]+)` \|$", text, re.MULTILINE)
    assert len(examples) >= 6
    for value, code in examples:
        assert varints(int(value)) == bytes.fromhex(code)
        assert unpack_integers(compressed(bytes.fromhex(code)), 1) == [int(value)]


def test_the_links_inside_the_specification_lead_somewhere() -> None:
    text = (SPEC / "pdeanim.md").read_text("utf-8")
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    anchors = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
    links = set(re.findall(r"\]\(#([^)]+)\)", text))
    assert links
    assert links <= anchors


def test_every_reason_names_a_section_of_the_specification() -> None:
    text = (SPEC / "pdeanim.md").read_text("utf-8")
    numbers = {number.rstrip(".") for number in re.findall(r"^#+ (\d[\d.]*)", text, re.MULTILINE)}
    for name, vector in MANIFEST["reject"].items():
        (number,) = re.findall(r"\((\d+(?:\.\d+)?)\)$", vector["reason"])
        assert number in numbers, name


def test_the_limits_and_constants_of_the_specification_are_the_librarys() -> None:
    text = " ".join((SPEC / "pdeanim.md").read_text("utf-8").split())
    values = f"{description.BYTES_PER_VALUE_BYTE} for each byte of attribute values"
    for said in (
        f"| {decoder.BYTES_PER_VERTEX} for each vertex |",
        f"| {version_1.BYTES_PER_CORNER} for each corner, {version_2.BYTES_PER_CORNER} in version 2 |",
        f"| {decoder.BYTES_PER_COEFFICIENT} for each coefficient of a segment",
        f"| {corrections.BYTES_PER_CORRECTION} for each correction of a segment |",
        f"{values}, {description.BYTES_PER_INDEX} for each index, {description.BYTES_PER_JSON_BYTE} for each byte",
        f"w = {', '.join(map(str, elements.PIECE_POINTS))} points",
        f"for k = {SERIES_TERMS}, {SERIES_TERMS - 1}, ..., 1",
        f"threshold {DEPENDENT:.0e}".replace("e-0", "e-"),
        f"threshold {DEPENDENT_IN_TIME:.0e}",
        f"| number of frames f | 1 to {MAX_SEGMENT_FRAMES} |",
        f"| exponent | 0 to {MAX_EXPONENT} |",
        f"| alpha | 0 to {MAX_RATE:g} |",
        f"free runs of length {curves.SHORTEST_RUN} along",
    ):
        assert said in text, said
    assert decoder.DEFAULT_MAX_MEMORY == 2**32
    assert (LARGEST, LARGEST_STEP) == (2**40, 2.0**160)
    assert (LARGEST_TIME, SHORTEST_TIME_STEP) == (2.0**53, 2.0**-53)
    assert description.MAX_JSON_BYTES == 2**24
