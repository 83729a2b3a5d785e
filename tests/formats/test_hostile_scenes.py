"""Scenes in `.pdeanim` files made to do harm: they are left out, and neither files nor memory are at risk."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import pytest

import pdecodec
from pdecodec.cli.main import run
from pdecodec.codec.sections.scene import Carrier
from pdecodec.errors import InputError
from tests.formats.test_carried_formats import alembic_shot, carried, exodus_shot


def left_out(animation: pdecodec.Animation, family: str, files: dict[str, bytes], path: Path) -> str:
    """Write an animation with other files in its carrier; return why its scene is left out, or nothing."""
    animation.carried = Carrier.of(family, [], [], files)
    lines = [one for one in pdecodec.write_sequence(animation, path, overwrite=True) if "left out" in one]
    assert [one.name for one in path.parent.iterdir()] == [path.name]
    return "".join(lines)


@pytest.mark.parametrize(
    "answer",
    [{"what": "frames", "of": "velocities", "frames": [0, 1]}, {"what": "frames", "of": "sequence", "frames": ["a", 1]},
     {"what": "done", "names": ["a", 5, []], "notices": []}, {"what": "done", "names": ["a", "b", [[]]], "notices": []},
     {"what": "done", "names": ["a", "b", []], "notices": [1]}, {"what": "done"}, {"what": "other"}, []],
)  # fmt: skip
def test_a_worker_that_was_taken_over_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: Any
) -> None:
    _, animation = carried(tmp_path, exodus_shot(tmp_path / "a.e"))
    arrays = {"asked": np.frombuffer(json.dumps(answer).encode(), np.uint8)}
    monkeypatch.setattr("pdecodec.system.workers.Worker.call", lambda *_: arrays)
    notices = pdecodec.write_sequence(animation, tmp_path / "b.e", isolate=True)
    assert "gave no answer that makes sense" in notices[0]
    animation.close()


@pytest.mark.data
def test_a_scene_that_ends_a_library_ends_only_its_worker(
    tmp_path: Path, shared_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("alembic3d", reason="what Alembic needs is not installed here")
    source = shared_data / "interop/abc/rotatingCube.abc"
    with pdecodec.open_sequence(source) as read:
        pdecodec.encode(read, tmp_path / "a.pdeanim")
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        assert animation.carried is not None
        files, clip = animation.carried.files(2**20), animation.to_array()
    # The damage by which test_alembic.py ends the library.
    damaged, random = bytearray(source.read_bytes()), Random(39)
    for _ in range(random.randint(1, 8)):
        damaged[random.randrange(len(damaged))] = random.randrange(256)
    cuts = json.dumps({**json.loads(files["cuts"]), "arrays": [], "samples": []}).encode()
    clip.carried = Carrier.of("alembic", [], [], {"cuts": cuts, "files/scene.abc": bytes(damaged)})
    pdecodec.encode(clip, tmp_path / "b.pdeanim")
    out = tmp_path / "out"
    out.mkdir()
    assert run(["decode", str(tmp_path / "b.pdeanim"), "-o", str(out / "b.abc"), "--isolate"]) == 0
    assert "left out: the library that reads this file crashed" in capsys.readouterr().err
    assert [one.name for one in out.iterdir()] == ["b.abc"]


@pytest.mark.parametrize(("member", "value"), [(4, 2**40), (4, -1), (4, None), (3, "O"), (3, "S99999999"), (3, 5)])
@pytest.mark.parametrize("make", ["alembic", "usd"])
def test_samples_of_a_hostile_scene_take_no_memory(tmp_path: Path, make: str, member: int, value: Any) -> None:
    if make == "usd":
        pytest.importorskip("pxr", reason="what USD needs is not installed here")
        from tests.support.usd_stages import usd_shot

        files, animation = carried(tmp_path, usd_shot(tmp_path / "in", "a.usda"))
        member = {3: 4, 4: 7}[member]
    else:
        pytest.importorskip("alembic3d", reason="what Alembic needs is not installed here")
        files, animation = carried(tmp_path, alembic_shot(tmp_path / "a.abc"))
    cuts = json.loads(files["cuts"])
    cuts["samples"][0][member] = value
    path = tmp_path / "out" / ("a.usda" if make == "usd" else "a.abc")
    path.parent.mkdir()
    assert left_out(animation, make, {**files, "cuts": json.dumps(cuts).encode()}, path)
    animation.close()


def test_an_alembic_tree_that_leaves_its_file_is_refused() -> None:
    pytest.importorskip("alembic3d", reason="what Alembic needs is not installed here")
    from pdecodec.formats.alembic.ogawa import blocks

    def words(*numbers: int) -> bytearray:
        return bytearray(b"Ogawa\xff\0\1" + struct.pack(f"<{len(numbers)}Q", *numbers))

    assert [*blocks(words(16, 1, 16))] == []  # a group in itself
    for tree in (words(99), words(16, 2**60), words(16, 1, 2**63 + 99), words(16, 1, 2**63 + 32, 2**62)):
        with pytest.raises(InputError, match="leaves the file"):
            list(blocks(tree))


def test_a_hostile_exodus_scene_reads_no_other_file_and_keeps_the_limit_of_memory(tmp_path: Path) -> None:
    files, animation = carried(tmp_path, exodus_shot(tmp_path / "a.e"))
    secret, out = tmp_path / "secret.h5", tmp_path / "out"
    out.mkdir()
    with h5py.File(secret, "w") as file:
        file["x"] = np.zeros(9)
    for kind, reason in (("virtual", "outside"), ("raw data", "outside"), ("hardly written", "its arrays take")):
        place = tmp_path / "b.e"
        place.write_bytes(files["files/scene.exo"])
        with h5py.File(place, "a") as file:
            if kind == "virtual":
                layout = h5py.VirtualLayout((9,), "f8")
                layout[:] = h5py.VirtualSource(str(secret), "x", (9,))
                file.create_virtual_dataset("extra", layout)
            elif kind == "raw data":
                file.create_dataset("extra", (9,), "f8", external=[(str(secret), 0, 72)])
            else:
                file.create_dataset("extra", (2, 2**40), "f8", chunks=(1, 8))[0, 0] = 1
        said = left_out(animation, "exodus", {**files, "files/scene.exo": place.read_bytes()}, out / "c.e")
        assert reason in said
    animation.close()


def test_cells_of_a_hostile_exodus_scene_are_written_to_no_other_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files, animation = carried(tmp_path, exodus_shot(tmp_path / "a.e"), solids="keep")
    clip = animation.to_array()
    animation.close()
    other = tmp_path / "other.h5"
    out = tmp_path / "out"
    out.mkdir()
    for kind in ("link", "raw data", "soft link", "group", "no file", "other steps", "too large"):
        with h5py.File(other, "w") as file:
            file["cells"] = np.zeros((1, 8), np.int32)
        before = other.read_bytes()
        (tmp_path / "b.e").write_bytes(files["files/scene.exo"])
        with h5py.File(tmp_path / "b.e", "a") as file:
            del file["connect1"]
            if kind == "link":
                file["connect1"] = h5py.ExternalLink(str(other), "cells")
            elif kind == "raw data":
                file.create_dataset("connect1", (1, 8), np.int32, external=[(str(other), 2048, 32)])
            elif kind == "soft link":
                file["connect1"] = h5py.SoftLink("/coordx")
            elif kind == "group":
                file.create_group("connect1")
            else:
                size = 2**40 if kind == "too large" else 1
                file.create_dataset("connect1", (size, 8), np.int32).attrs["elem_type"] = np.bytes_(b"HEX8")
            if kind == "other steps":
                del file["vals_nod_var1"]
                file.create_dataset("vals_nod_var1", (3, 5), np.float64)
            if kind == "too large":
                cuts = {**json.loads(files["cuts"]), "blocks": []}
                files["cuts"] = json.dumps(cuts).encode()
        content = b"" if kind == "no file" else (tmp_path / "b.e").read_bytes()
        clip.carried = Carrier.of("exodus", [], [], {**files, "files/scene.exo": content})
        pdecodec.encode(clip, tmp_path / "b.pdeanim", overwrite=True)
        code = run(["decode", str(tmp_path / "b.pdeanim"), "-o", str(out / "b.e"), "--overwrite"])
        said = capsys.readouterr().err
        assert (code, "memory" in said) == (4, True) if kind == "too large" else code == 0
        assert ("scene of the file is left out: " in said) == (kind != "too large")
        assert other.read_bytes() == before
        assert [one.name for one in out.iterdir()] == ["b.e"]
