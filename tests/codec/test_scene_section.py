"""Section SCEN: names, sizes and sums of its streams; files without a scene have no such section."""

from __future__ import annotations

import io
import zlib
from pathlib import Path

import numpy as np
import pytest
import zstandard

import pdecodec
from pdecodec.codec.container import BESIDE_MOTION
from pdecodec.codec.editing import cut_animation, join_animations
from pdecodec.codec.sections.bytestream import FieldWriter
from pdecodec.codec.sections.scene import LONG_DISTANCE_BYTES, Carrier, SceneStream, decode_scene, encode_scene
from pdecodec.errors import CorruptFileError, InputError, LimitError
from spec.decoder.fields import CorruptFileError as IndependentCorruptFileError
from spec.decoder.scene import read_scene

CONTENT = {"cuts": b"{}", "files/a/b.usda": b"#usda 1.0\n", "files/empty": b""}


def carrier(**files: bytes) -> Carrier:
    return Carrier.of("gltf", [("camera", 2)], ["wood.png"], files or CONTENT)


def clip(scene: Carrier | None = None) -> pdecodec.ArraySequence:
    made = pdecodec.ArraySequence(np.random.default_rng(1).normal(size=(6, 4, 3)), fps=24)
    made.carried = scene
    return made


def section(name: str = "a", size: int = 1, checksum: int | None = None, packed: bytes | None = None) -> bytes:
    """Return a section with one stream, whose content is a byte unless given otherwise."""
    writer = FieldWriter()
    writer.text("gltf")
    for number in (0, 0, 1):
        writer.count(number)
    frame = zstandard.ZstdCompressor(write_content_size=True).compress(b"x") if packed is None else packed
    writer.text(name)
    writer.count(size)
    writer.count(len(frame))
    writer.numbers("I", zlib.crc32(b"x") if checksum is None else checksum)
    return writer.to_bytes() + frame


def test_a_scene_comes_back_and_the_independent_decoder_reads_it() -> None:
    data = encode_scene(carrier())
    read, plain = decode_scene(data), read_scene(data)
    assert plain is not None
    assert read.files(100) == plain.streams == CONTENT
    assert (read.family, read.contents, read.outside) == ("gltf", (("camera", 2),), ("wood.png",))
    assert (plain.family, plain.contents, plain.outside) == ("gltf", [("camera", 2)], ["wood.png"])


@pytest.mark.parametrize(
    "data",
    [
        *(
            section(name)
            for name in ("", "/a", "../a", "a/../b", "a//b", ".", "a\\b", "c:a", "a\n", "a.", " a", "x" * 256)
        ),
        section(size=2),
        section(size=0),
        section(size=2**41),
        section(checksum=1),
        section(packed=b""),
        section(packed=b"nothing"),
        section(packed=zstandard.ZstdCompressor(write_content_size=False).compress(b"x")),
        section() + b"\0",
        section()[:-1],
        section().replace(b"\x04gltf", b"\x00", 1),
        section().replace(b"\x04gltf\0\0\x01", b"\x04gltf\0\0\x00", 1),
        section().replace(b"\x04gltf\0", b"\x04gltf\xff\xff\xff\x7f", 1),
    ],
    ids=range(24),
)
def test_violations_of_the_format_are_refused_in_one_line(data: bytes) -> None:
    with pytest.raises(CorruptFileError, match=r"^section SCEN [^\n]*$"):
        decode_scene(data).files(2**20)
    with pytest.raises(IndependentCorruptFileError):
        read_scene(data)


@pytest.mark.parametrize("names", [("files/a", "files/A"), ("files/a", "files/a/b")])
def test_names_that_a_folder_cannot_hold_together_are_refused(names: tuple[str, str]) -> None:
    data = encode_scene(carrier(**dict.fromkeys(names, b"x")))
    with pytest.raises(CorruptFileError, match="two streams of one name"):
        decode_scene(data)
    with pytest.raises(IndependentCorruptFileError):
        read_scene(data)


def test_a_scene_takes_no_more_memory_than_the_limit() -> None:
    bomb = Carrier("gltf", (), (), (SceneStream.of("files/a", bytes(2**24)),))
    assert len(encode_scene(bomb)) < 2_000
    with pytest.raises(LimitError, match="a scene of 16777216 bytes"):
        decode_scene(encode_scene(bomb)).files(2**23)
    declared = zstandard.ZstdCompressor().compress(bytes(2**24))
    lying = SceneStream("files/a", 10, 0, declared)
    with pytest.raises(CorruptFileError, match="damaged stream"):
        decode_scene(encode_scene(Carrier("gltf", (), (), (lying,)))).files(2**23)


def test_large_streams_are_matched_over_long_distances() -> None:
    noise = np.random.default_rng(0).integers(0, 256, 10 * LONG_DISTANCE_BYTES, np.uint8).tobytes()
    assert len(SceneStream.of("a", noise + noise).packed) < 1.01 * len(noise)


def test_only_a_sequence_with_a_scene_has_the_section() -> None:
    plain, dropped = pdecodec.encode(clip()), pdecodec.encode(clip(carrier()), scene="drop")
    kept = pdecodec.encode(clip(carrier()))
    assert plain.data == dropped.data
    assert kept.scene == (("camera", 2),)
    assert kept.motion_bytes == plain.motion_bytes + kept.sections["container"] - plain.sections["container"]
    assert (
        kept.file_bytes - kept.motion_bytes == kept.scene_bytes == sum(kept.sections.get(k, 0) for k in BESIDE_MOTION)
    )
    assert kept.data is not None
    with pdecodec.open(kept.data) as animation:
        assert animation.carried == carrier()
        assert animation.info()["scene"]["contents"] == [{"kind": "camera", "count": 2}]
        assert animation.info()["ratio"] == kept.raw_bytes / kept.motion_bytes
        again = pdecodec.encode(animation)
        assert again.scene_bytes == kept.scene_bytes
        assert pdecodec.encode(animation, uv_tolerance=1e-3).scene_note


def test_a_free_order_drops_the_scene_with_a_note() -> None:
    report = pdecodec.encode(clip(carrier()), order="free")
    assert not report.scene_bytes
    assert any("the scene around the motion is not kept" in one for one in report.warnings)


def test_cut_and_join_pass_a_scene_on(tmp_path: Path) -> None:
    whole = pdecodec.encode(clip(carrier()), tmp_path / "a.pdeanim", group_frames=3)
    cut_animation(tmp_path / "a.pdeanim", tmp_path / "b.pdeanim", 0, 3)
    cut_animation(tmp_path / "a.pdeanim", tmp_path / "c.pdeanim", 3, 6)
    join_animations(tmp_path / "b.pdeanim", [tmp_path / "c.pdeanim"], tmp_path / "d.pdeanim")
    for name in "bcd":
        with pdecodec.open(tmp_path / f"{name}.pdeanim") as animation:
            assert animation.carried == carrier()
            assert animation.sections["SCEN"] == whole.scene_bytes


def test_damage_of_a_scene_is_found_and_the_motion_is_saved_without_it(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    pdecodec.encode(clip(carrier()), path)
    assert pdecodec.check_file(path, deep=True).is_sound
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    assert [one.section for one in pdecodec.check_file(path).findings] == ["SCEN"]
    with pdecodec.salvage(path) as saved:
        assert saved.sequence.frame_count == 6
        assert saved.missing == ()
        assert [one.partition(" (")[0] for one in saved.lost] == ["the scene around the motion"]
        assert saved.sequence.carried is None


def test_deep_checks_unpack_a_scene(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    wrong = Carrier("gltf", (), (), (SceneStream("files/a", 3, 0, SceneStream.of("a", b"abc").packed),))
    pdecodec.encode(clip(wrong), path)
    assert pdecodec.check_file(path).is_sound
    assert [one.section for one in pdecodec.check_file(path, deep=True).findings] == ["SCEN"]


def test_a_scene_is_read_from_an_open_file_and_from_a_pickle(tmp_path: Path) -> None:
    report = pdecodec.encode(clip(carrier()))
    assert report.data is not None
    with pdecodec.open(io.BytesIO(report.data)) as animation:
        assert animation.carried == carrier()
        assert animation.read_frames(0, 1).shape == (1, 4, 3)


def test_a_source_with_a_name_that_no_carrier_can_hold_is_refused() -> None:
    with pytest.raises(InputError, match=r"whose name"):
        carrier(**{"files/a?b": b""})
