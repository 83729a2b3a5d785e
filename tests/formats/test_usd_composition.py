"""Missing parts of USD stages: USD continues without them; the reader names them in a notice, or refuses the stage."""

from __future__ import annotations

from pathlib import Path

import pytest

from pdecodec.cli.main import run
from pdecodec.errors import InputError
from pdecodec.formats import open_sequence

pytest.importorskip("pxr", reason="USD is not installed here (pip install 'pdecodec[usd]')")

MESH = """def Mesh "m" {
int[] faceVertexCounts = [3]
int[] faceVertexIndices = [0, 1, 2]
point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
}
"""

CLIPS = """(clips = { dictionary default = {
    double2[] active = [(0, 0), (5, 1)]
    double2[] times = [(0, 0), (10, 10)]
    asset[] assetPaths = [@./one.usda@, @./two.usda@]
    string primPath = "/m"
    asset manifestAssetPath = @./manifest.usda@
} }) {"""


def clip(folder: Path, name: str, *samples: str) -> None:
    body = f".timeSamples = {{ {', '.join(samples)} }}" if samples else ""
    (folder / f"{name}.usda").write_text(f'#usda 1.0\nover "m" {{\npoint3f[] points{body}\n}}\n')


def stage(folder: Path, body: str, metadata: str = "") -> Path:
    (folder / "lib.usda").write_text(f"#usda 1.0\n{MESH}")
    (folder / "garbage.usda").write_text("garbage")
    path = folder / "x.usda"
    path.write_text(f"#usda 1.0\n(\n{metadata}\n)\n{body}")
    return path


GONE = "no file that can be opened, and it"


@pytest.mark.parametrize(
    ("metadata", "body", "name", "feature"),
    [
        ("subLayers = [@./gone.usda@, @./lib.usda@]", "", "gone.usda", f"{GONE} is a sublayer"),
        ("", 'def "r" (references = @./gone.usda@) {}', "gone.usda", f"{GONE} is a reference of 'r'"),
        ("", 'def "a" {\ndef "p" (payload = @./gone.usda@) {}\n}', "gone.usda", f"{GONE} is a payload of 'a/p'"),
        ("", 'def "r" (references = @./garbage.usda@) {}', "garbage.usda", f"{GONE} is a reference of 'r'"),
        (
            "",
            'def "r" (references = @./lib.usda@</none>) {}',
            "lib.usda</none>",
            "no prim that can be found, and it is a reference of 'r'",
        ),
        (
            "",
            'def "a" (references = @./gone.usda@) {}\ndef "b" (references = @./gone.usda@) {}',
            "gone.usda",
            f"{GONE} is a reference of 'a', 'b'",
        ),
        ("", "", "./two.usda", f"{GONE} holds values of 'm'"),
    ],
)
def test_a_missing_source_of_geometry_is_refused_by_name(
    metadata: str, body: str, name: str, feature: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    clip(tmp_path, "one", "0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)]")
    clip(tmp_path, "manifest")
    clipped = MESH.replace("{", CLIPS, 1) if name == "./two.usda" else MESH
    path = stage(tmp_path, clipped + body, metadata)
    with pytest.raises(InputError) as caught:
        open_sequence(path)
    assert (caught.value.object, caught.value.setting) == (name, "skip_unsupported")
    assert f"has {feature}" in str(caught.value)
    with open_sequence(path, skip_unsupported=True) as read:
        assert [one.name for one in read.unsupported] == [name]
        assert f"object {name!r} is left out: it has {feature}" in read.notices
        assert read.vertex_count == 3
    assert capfd.readouterr().err == ""


def test_missing_looks_and_cycles_are_noted_in_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    body = 'def Material "look" (references = @./gone.usda@) {}\ndef "round" (references = </round>) {}'
    path = stage(tmp_path, MESH + body)
    assert run(["encode", str(path), str(tmp_path / "x.pdeanim")]) == 0
    said = capfd.readouterr().err
    assert "note: missing: gone.usda, a reference of /look\n" in said
    assert said.count("gone.usda") == 1
    assert "note: USD does not compose /round: Cycle detected" in said
    assert ".cpp" not in said


def test_value_clips_are_read_and_their_files_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip(tmp_path, "one", "0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)]")
    clip(tmp_path, "two", "5: [(0, 0, 1), (1, 0, 1), (0, 1, 1)]", "10: [(0, 0, 2), (1, 0, 2), (0, 1, 2)]")
    clip(tmp_path, "manifest")
    path = stage(tmp_path, MESH[: MESH.index(" = [(0,")].replace("{", CLIPS, 1) + "\n}\n")
    with open_sequence(path) as read:
        assert read.read_frames(0, read.frame_count)[:, 0, 2].tolist() == [0, 1, 2]
    assert run(["info", str(path), "--json"]) == 0
    files = [path, *(tmp_path / f"{name}.usda" for name in ("one", "two", "manifest"))]
    assert f'"source_bytes": {sum(one.stat().st_size for one in files)}' in capsys.readouterr().out
