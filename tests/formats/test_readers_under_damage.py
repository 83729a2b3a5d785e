"""Readers of other formats on files that are damaged with knowledge of the format: they raise only our own errors.

`make fuzz-readers` does the same with as many files as time allows. Files in which it has found errors are tested
here, by their number or as a file.
"""

from __future__ import annotations

import io
import json
import struct
import tokenize
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import InputError
from pdecodec.formats import open_sequence, write_sequence
from tests.slow.fuzz.readers import mutant, read_all, write
from tests.slow.fuzz.seeds import target
from tests.support.scene_cases import scene

MUTANTS = 60
"""Number of damaged files for each reader."""


@pytest.mark.parametrize("reader", ["obj", "mdd", "pc2", "ply", "stl", "off", "gltf", "glb", "npz", "hdf5"])
def test_damaged_files_are_refused_by_our_errors_or_read_whole(reader: str, tmp_path: Path) -> None:
    fuzzed = target(reader)
    changed = 0
    for number in range(MUTANTS):
        seed, data = mutant(fuzzed, number)
        changed += data != seed.files[seed.changed]
        write(tmp_path, seed, data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read_all(tmp_path, seed)
    assert changed > MUTANTS // 2


def test_a_mutant_is_the_same_whenever_it_is_made() -> None:
    for fuzzed in (target("npz"), target("gltf")):
        assert [mutant(fuzzed, number)[1] for number in range(5)] == [mutant(fuzzed, number)[1] for number in range(5)]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a .gltf file with an animation of morph targets."""
    path = tmp_path_factory.mktemp("gltf") / "clip.gltf"
    write_sequence(scene(frames=3), path)
    return path


def refused(clip: Path, tmp_path: Path, change: Any) -> str:
    """Return the message about a file after a change of its JSON."""
    tree = json.loads(clip.read_text())
    change(tree)
    for other in clip.parent.iterdir():
        (tmp_path / other.name).write_bytes(other.read_bytes())
    (tmp_path / clip.name).write_text(json.dumps(tree))
    with pytest.raises(InputError) as caught, open_sequence(tmp_path / clip.name) as sequence:
        sequence.read_frames(0, 1)
    return caught.value.message


@pytest.mark.parametrize(
    ("kind", "key", "value", "words"),
    [
        ("nodes", "children", 5, "nodes[0].children is no list"),
        ("nodes", "children", [-1], "nodes[0].children[0] is no whole number, or out of range"),
        ("nodes", "translation", [1, 2], "nodes[0].translation is not a list of 3 numbers"),
        ("nodes", "translation", [1, 2, float("nan")], "nodes[0].translation is no number, or out of range"),
        ("accessors", "count", float("inf"), "accessors[0].count is no whole number, or out of range"),
        ("accessors", "bufferView", -1, "accessors[0].bufferView is no whole number, or out of range"),
        ("bufferViews", "byteLength", 2**63, "bufferViews[0].byteLength is no whole number, or out of range"),
        ("buffers", "uri", 1.5, "buffers[0].uri is no text"),
        ("meshes", "primitives", {}, "meshes[0].primitives is no list"),
        ("animations", "channels", None, "animations[0].channels is no list"),
        ("scenes", "nodes", True, "scenes[0].nodes is no list"),
    ],
)
def test_gltf_with_a_value_of_another_sort_is_refused_by_its_place(
    kind: str, key: str, value: Any, words: str, clip: Path, tmp_path: Path
) -> None:
    message = refused(clip, tmp_path, lambda tree: tree[kind][0].update({key: value}))
    assert message == f"{words}; export the file again"


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("animations 0 channels 0 sampler", 99, "animation 0 is damaged (list index out of range)"),
        ("animations 0 samplers 0 input", 1, "animation 0 is damaged ("),
        ("meshes 0 primitives 0 indices", 99, "accessor 99 is damaged or missing ("),
        ("accessors 0 bufferView", 99, "accessor 0 is damaged or missing ("),
        ("accessors 0 count", 10**6, "accessor 0 is damaged or missing (it ends after its buffer view)"),
        ("bufferViews 0 byteLength", 10**9, "(its buffer view ends after its buffer)"),
    ],
)
def test_gltf_whose_numbers_do_not_fit_each_other_is_refused(
    place: str, value: int, words: str, clip: Path, tmp_path: Path
) -> None:
    def change(tree: Any) -> None:
        *steps, last = [int(step) if step.isdecimal() else step for step in place.split()]
        for step in steps:
            tree = tree[step]
        tree[last] = value

    assert words in refused(clip, tmp_path, change)


def test_noted_attributes_of_something_else_than_there_is_are_refused(clip: Path, tmp_path: Path) -> None:
    def change(tree: Any) -> None:
        for mesh in tree["meshes"]:
            for color in mesh["extras"]["pdecodec"].get("colors", {}).values():
                color["domain"] = "moon"

    assert "has the unknown domain 'moon'; use vertex, face, corner, cell, object" in refused(clip, tmp_path, change)


@pytest.mark.parametrize("extras", [5, "x", {"pdecodec": 3}, {"pdecodec": {"colors": True, "of": "0"}}, []])
def test_extras_of_gltf_may_be_anything(extras: Any, clip: Path, tmp_path: Path) -> None:
    tree = json.loads(clip.read_text())
    for kind in ("meshes", "animations", "nodes"):
        for entry in tree[kind]:
            entry["extras"] = extras
    tree["asset"]["extras"] = extras
    for other in clip.parent.iterdir():
        (tmp_path / other.name).write_bytes(other.read_bytes())
    (tmp_path / clip.name).write_text(json.dumps(tree))
    with open_sequence(tmp_path / clip.name) as sequence:
        assert np.isfinite(sequence.read_frames(0, 1)).all()


def test_an_archive_with_a_malformed_header_is_refused(tmp_path: Path) -> None:
    header = b"{'descr': ('<f4', 'fortran_order': False, 'shape': (1, 1, 3), }"
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    member = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(12)
    with pytest.raises(tokenize.TokenError):
        np.load(io.BytesIO(member), allow_pickle=False)
    with zipfile.ZipFile(tmp_path / "clip.npz", "w") as archive:
        archive.writestr("points.npy", member)
    with pytest.raises(InputError, match=r"clip\.npz"):
        open_sequence(tmp_path / "clip.npz")
