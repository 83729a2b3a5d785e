"""The registry of formats: which format takes a path, and how a new format is added."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pdecodec.codec.container import IDENTIFIER
from pdecodec.errors import CorruptFileError, InputError, PdecodecError, SettingsError
from pdecodec.formats import list_formats, open_sequence, write_sequence
from pdecodec.mesh.sequence import ArraySequence

TWO_FRAMES = ArraySequence(np.arange(18, dtype=np.float32).reshape(2, 3, 3), fps=24)


def test_the_list_of_formats_shows_what_each_can_do():
    table = {entry.name: (entry.extensions, entry.reads, entry.writes) for entry in list_formats()}
    assert table["obj"] == ((".obj",), True, True)
    assert table["hdf5"] == ((".h5", ".hdf5"), True, True)
    assert table["pdeanim"] == ((".pdeanim",), True, False)


@pytest.mark.parametrize("name", ["x.npz", "x.h5", "x.hdf5", "x.NPZ", "x", "x/", "x.v3/"])
def test_the_extension_chooses_the_format_and_no_extension_means_a_folder_of_obj(tmp_path: Path, name: str):
    target = f"{tmp_path}/{name}"
    write_sequence(TWO_FRAMES, target)
    with open_sequence(target) as read:
        assert np.array_equal(read.read_frames(0, 2), TWO_FRAMES.points)
    assert Path(target).is_dir() == ("." not in name or name.endswith("/"))


def test_a_folder_whose_name_has_a_dot_takes_frames(tmp_path: Path):
    (tmp_path / "shirt.v2").mkdir()
    write_sequence(TWO_FRAMES, tmp_path / "shirt.v2")
    names = sorted(item.name for item in (tmp_path / "shirt.v2").iterdir())
    assert names == ["shirt.v2.0000.obj", "shirt.v2.0001.obj"]
    assert open_sequence(tmp_path / "shirt.v2").frame_count == 2


@pytest.mark.parametrize(("extension", "wrong"), [("npz", "dat"), ("h5", "cache"), ("npz", "zip")])
def test_magic_bytes_choose_the_format_where_the_extension_says_nothing(tmp_path: Path, extension: str, wrong: str):
    write_sequence(TWO_FRAMES, tmp_path / f"x.{extension}")
    (tmp_path / f"x.{extension}").rename(tmp_path / f"x.{wrong}")
    with open_sequence(tmp_path / f"x.{wrong}") as read:
        assert np.array_equal(read.read_frames(0, 2), TWO_FRAMES.points)


@pytest.mark.parametrize(
    ("name", "content", "error", "message"),
    [
        ("x.npz", IDENTIFIER, InputError, r"animation \(pdeanim\); rename it to end in \.pdeanim"),
        ("x.obj", IDENTIFIER, InputError, r"\.pdeanim"),
        ("x.h5", b"PK\x03\x04", InputError, r"NumPy archive .* \.npz"),
        ("x.npz", b"\x89HDF\r\n\x1a\n", InputError, r"HDF5 .* \.h5"),
        ("x", IDENTIFIER, CorruptFileError, "ends inside its header"),
        *(
            ("x.dat", content, InputError, r"the readable ones are .*\.pdeanim, \.obj, \.npz, \.h5, \.hdf5")
            for content in (b"", b"PK", b"garbage" * 9)
        ),
        *(
            (name, None, InputError, "there is no such file")
            for name in ("x.npz", "x.h5", "x.obj", "x.dat", "x.pdeanim", "x", "no/x.npz")
        ),
    ],
)
def test_a_file_of_another_format_or_of_none_is_refused(
    tmp_path: Path, name: str, content: bytes | None, error: type[PdecodecError], message: str
):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(error, match=message):
        open_sequence(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("x.xyz", r"no format with the extension '\.xyz' can be written; use \.obj, \.npz, \.h5, \.hdf5"),
        ("x.pdeanim", r"cannot be written here; use pdecodec\.encode"),
        ("folder.npz", "is a folder; name a file in it"),
        ("folder.h5", "is a folder; name a file in it"),
    ],
)
def test_a_name_that_cannot_be_written_is_refused(tmp_path: Path, name: str, message: str):
    if name.startswith("folder"):
        (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=message):
        write_sequence(TWO_FRAMES, tmp_path / name, overwrite=True)


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan"), float("inf")])
def test_a_frame_rate_must_be_a_positive_number_and_none_is_given_to_a_pdeanim_file(tmp_path: Path, fps: float):
    with pytest.raises(SettingsError, match="must be a positive number"):
        write_sequence(TWO_FRAMES, tmp_path / "x.npz", fps=fps)
    with pytest.raises(SettingsError, match="must be a positive number"):
        open_sequence(tmp_path / "x.npz", fps=fps)
    (tmp_path / "x.pdeanim").write_bytes(b"anything")
    with pytest.raises(SettingsError, match="store their times"):
        open_sequence(tmp_path / "x.pdeanim", fps=24)


def test_a_folder_of_two_formats_asks_for_a_pattern(tmp_path: Path):
    (tmp_path / "1.obj").write_text("v 0 0 0\n")
    (tmp_path / "1.ply").write_text("ply\n")
    with pytest.raises(InputError, match=r"frames of several formats \(obj, ply\); give a frame pattern"):
        open_sequence(tmp_path)


def test_packages_add_formats_by_entry_points_and_a_broken_one_is_named_where_it_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    package = tmp_path / "site"
    (package / "studio-1.0.dist-info").mkdir(parents=True)
    (package / "studio-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: studio\nVersion: 1.0\n")
    (package / "studio-1.0.dist-info" / "entry_points.txt").write_text(
        "[pdecodec.formats]\ncache = studio:CACHE\nbroken = studio:NOTHING\ntaken = studio:TAKEN\n"
    )
    (package / "studio.py").write_text(
        "import numpy as np\n"
        "from pdecodec.formats import Format\n"
        "from pdecodec.mesh.sequence import ArraySequence\n"
        "def read(path, *, fps):\n"
        "    return ArraySequence(np.full((2, 3, 3), float(path.read_text())), fps=fps)\n"
        "def write(sequence, output):\n"
        "    with output.whole_file() as partial:\n"
        "        partial.write_text(str(sequence.read_frames(0, 1)[0, 0, 0]))\n"
        "    return ('one number is kept',)\n"
        "CACHE = Format(name='studio', title='Cache', extensions=('.studio',), reader='studio:read',\n"
        "               writer='studio:write')\n"
        "TAKEN = Format(name='taken', title='Taken', extensions=('.obj',))\n"
    )
    code = (
        "from pdecodec.formats import Format, list_formats, open_sequence, register_format, write_sequence\n"
        "from pdecodec.cli.main import run\n"
        "print([entry.name for entry in list_formats()][-1])\n"
        "mine = Format(name='mine', title='Mine', extensions=('.mine',), magic=(b'1.5',), reader='studio:read')\n"
        "register_format(mine)\n"
        "register_format(Format(name='new', title='New', extensions=('.new',), reader='gone:read', extra='new'))\n"
        "print(open_sequence('x.any').read_frames(0, 1)[0, 0].tolist(), mine in list_formats())\n"
        "for name in ('x.new', 'x.mine', 'obj', 'newer'):\n"
        "    try:\n"
        "        if name == 'x.new':\n"
        "            open_sequence(name)\n"
        "        elif name == 'x.mine':\n"
        "            write_sequence(open_sequence('x.any'), name)\n"
        "        register_format(Format(name=name, title='Newer', extensions=('.npz',)))\n"
        "    except Exception as error:\n"
        "        print(type(error).__name__, error)\n"
        "from pdecodec.mesh.sequence import ArraySequence\n"
        "print(write_sequence(ArraySequence([[[7, 7, 7]]]), 'x.studio'))\n"
        "print(open_sequence('x.studio').read_frames(0, 1)[0, 0].tolist())\n"
        "run(['convert', 'x.studio', 'x.other'])\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(package))
    (tmp_path / "x.any").write_bytes(b"1.5")
    (tmp_path / "x.new").write_bytes(b"any")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout.splitlines() == [
        *("studio", "[1.5, 1.5, 1.5] True"),
        "MissingExtraError x.new: New needs the package gone; run: pip install 'pdecodec[new]'",
        "InputError x.mine: Mine (mine) cannot be written here; choose another format",
        "SettingsError format 'obj' collides with 'obj'; choose another name or extension",
        "SettingsError format 'newer' collides with 'npz'; choose another name or extension",
        *("('one number is kept',)", "[7.0, 7.0, 7.0]"),
    ]
    assert "broken could not be loaded (AttributeError: module 'studio' has no attribute 'NOTHING')" in done.stderr
    assert "taken could not be loaded (SettingsError: format 'taken' collides with 'obj'" in done.stderr
