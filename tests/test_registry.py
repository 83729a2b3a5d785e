"""The registry of formats: which one takes a path, and how a new one joins."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from pdecodec.container import IDENTIFIER
from pdecodec.errors import CorruptFileError, InputError, MissingExtraError, SettingsError
from pdecodec.formats import Format, list_formats, open_sequence, register_format, registry, write_sequence
from pdecodec.sequence import ArraySequence

TWO_FRAMES = ArraySequence(np.arange(18, dtype=np.float32).reshape(2, 3, 3), fps=24)


@pytest.fixture
def own_formats(monkeypatch: pytest.MonkeyPatch) -> None:
    """Registrations that end with the test."""
    monkeypatch.setattr(registry, "_formats", dict(registry._formats))


def test_importing_the_formats_loads_none_of_what_they_need():
    program = (
        "import sys, pdecodec.formats\n"
        "print([name for name in ('h5py', 'numba', 'fileseq', 'meshio', 'zipfile') if name in sys.modules])"
    )
    checkout = Path(__file__).resolve().parent.parent
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=checkout)
    assert done.stdout.strip() == "[]"


def test_the_package_is_imported_under_its_full_name_only():
    checkout = Path(__file__).resolve().parent.parent
    done = subprocess.run([sys.executable, "-c", "import formats"], capture_output=True, text=True, cwd=checkout)
    assert done.returncode == 1
    assert "import this package as pdecodec.formats, not as formats" in done.stderr


def test_the_list_of_formats_says_what_each_can_do():
    table = {entry.name: (entry.extensions, entry.reads, entry.writes) for entry in list_formats()}
    assert table["obj"] == ((".obj",), True, True)
    assert table["npz"] == ((".npz",), True, True)
    assert table["hdf5"] == ((".h5", ".hdf5"), True, True)
    assert table["pdeanim"] == ((".pdeanim",), True, False)


@pytest.mark.parametrize("name", ["x.npz", "x.h5", "x.hdf5", "x.NPZ", "x", "x/"])
def test_the_extension_chooses_the_format_and_none_means_a_folder_of_obj(tmp_path: Path, name: str):
    target = f"{tmp_path}/{name}"
    write_sequence(TWO_FRAMES, target)
    with open_sequence(target) as read:
        assert np.array_equal(read.read_frames(0, 2), TWO_FRAMES.points)
    assert (tmp_path / "x").is_dir() == ("." not in name)


@pytest.mark.parametrize(("extension", "wrong"), [("npz", "dat"), ("h5", "cache"), ("npz", "zip")])
def test_magic_bytes_choose_the_format_where_the_extension_says_nothing(tmp_path: Path, extension: str, wrong: str):
    write_sequence(TWO_FRAMES, tmp_path / f"x.{extension}")
    (tmp_path / f"x.{extension}").rename(tmp_path / f"x.{wrong}")
    with open_sequence(tmp_path / f"x.{wrong}") as read:
        assert np.array_equal(read.read_frames(0, 2), TWO_FRAMES.points)


@pytest.mark.parametrize(
    ("head", "name", "right"),
    [
        (IDENTIFIER, "x.npz", r"pdecodec animation file \(pdeanim\) .* rename it to end in \.pdeanim"),
        (IDENTIFIER, "x.obj", r"\.pdeanim"),
        (b"PK\x03\x04", "x.h5", r"NumPy archive .* \.npz"),
        (b"\x89HDF\r\n\x1a\n", "x.npz", r"HDF5 .* \.h5"),
    ],
)
def test_a_file_named_as_another_format_is_refused_by_its_right_name(
    tmp_path: Path, head: bytes, name: str, right: str
):
    (tmp_path / name).write_bytes(head + b"and more")
    with pytest.raises(InputError, match=right):
        open_sequence(tmp_path / name)


def test_an_animation_without_an_extension_is_known_by_its_first_bytes(tmp_path: Path):
    (tmp_path / "x").write_bytes(IDENTIFIER)
    with pytest.raises(CorruptFileError, match="ends inside its header"):
        open_sequence(tmp_path / "x")


@pytest.mark.parametrize("content", [b"", b"PK", b"garbage" * 9])
def test_a_file_of_no_known_format_is_refused_with_those_that_are(tmp_path: Path, content: bytes):
    (tmp_path / "x.dat").write_bytes(content)
    with pytest.raises(InputError, match=r"readable are .*\.pdeanim, \.obj, \.npz, \.h5, \.hdf5"):
        open_sequence(tmp_path / "x.dat")


@pytest.mark.parametrize("name", ["x.npz", "x.h5", "x.obj", "x.dat", "x.pdeanim", "x", "no/x.npz"])
def test_a_file_that_is_not_there_is_refused(tmp_path: Path, name: str):
    with pytest.raises(InputError, match="there is no such file"):
        open_sequence(tmp_path / name)


def test_an_extension_that_is_not_written_is_refused_with_those_that_are(tmp_path: Path):
    with pytest.raises(InputError, match=r"no format is written as '\.xyz'; use \.obj, \.npz, \.h5, \.hdf5"):
        write_sequence(TWO_FRAMES, tmp_path / "x.xyz")


def test_pdeanim_is_encoded_not_written(tmp_path: Path):
    with pytest.raises(InputError, match=r"cannot be written here; use pdecodec\.encoder\.encode"):
        write_sequence(TWO_FRAMES, tmp_path / "x.pdeanim")


def test_a_frame_rate_cannot_be_given_to_a_pdeanim_file(tmp_path: Path):
    (tmp_path / "x.pdeanim").write_bytes(b"anything")
    with pytest.raises(SettingsError, match="stores its own times"):
        open_sequence(tmp_path / "x.pdeanim", fps=24)


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan"), float("inf")])
def test_a_frame_rate_must_be_a_positive_number(tmp_path: Path, fps: float):
    with pytest.raises(SettingsError, match="must be a positive number"):
        write_sequence(TWO_FRAMES, tmp_path / "x.npz", fps=fps)
    with pytest.raises(SettingsError, match="must be a positive number"):
        open_sequence(tmp_path / "x.npz", fps=fps)


@pytest.mark.parametrize("name", ["x.npz", "x.h5"])
def test_a_folder_in_the_place_of_a_file_is_refused(tmp_path: Path, name: str):
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match="is a folder; name a file in it"):
        write_sequence(TWO_FRAMES, tmp_path / name, overwrite=True)
    assert list((tmp_path / name).iterdir()) == []


def test_a_folder_whose_name_has_a_dot_takes_frames(tmp_path: Path):
    (tmp_path / "shirt.v2").mkdir()
    write_sequence(TWO_FRAMES, tmp_path / "shirt.v2")
    write_sequence(TWO_FRAMES, f"{tmp_path}/shirt.v3/")
    for name in ("shirt.v2", "shirt.v3"):
        assert sorted(item.name for item in (tmp_path / name).iterdir()) == [f"{name}.0000.obj", f"{name}.0001.obj"]
        assert open_sequence(tmp_path / name).frame_count == 2


def test_a_place_that_cannot_be_written_to_is_refused_by_every_format(tmp_path: Path):
    for name in ("no/x.npz", "no/x.h5"):
        with pytest.raises(InputError, match="this folder does not exist"):
            write_sequence(TWO_FRAMES, tmp_path / name)


@pytest.mark.usefixtures("own_formats")
def test_a_new_format_joins_with_one_registration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    module = ModuleType("my_format")
    module.open_mine = lambda path, *, fps: TWO_FRAMES  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "my_format", module)
    register_format(
        Format(name="mine", title="Mine", extensions=(".mine",), magic=(b"MINE",), reader="my_format:open_mine")
    )
    (tmp_path / "x.other").write_bytes(b"MINE and more")
    assert open_sequence(tmp_path / "x.other") is TWO_FRAMES
    assert "mine" in [entry.name for entry in list_formats()]
    with pytest.raises(InputError, match=r"Mine \(mine\) cannot be written here; choose another format"):
        write_sequence(TWO_FRAMES, tmp_path / "x.mine")


@pytest.mark.usefixtures("own_formats")
def test_a_missing_extra_says_how_to_install_it(tmp_path: Path):
    register_format(
        Format(name="new", title="New", extensions=(".new",), reader="not_installed_here:open_new", extra="new")
    )
    (tmp_path / "x.new").write_bytes(b"any")
    with pytest.raises(MissingExtraError, match=r"New needs the package not_installed_here; run: pip install 'pdec"):
        open_sequence(tmp_path / "x.new")


def test_a_folder_of_two_formats_asks_for_a_pattern(tmp_path: Path):
    (tmp_path / "1.obj").write_text("v 0 0 0\n")
    (tmp_path / "1.ply").write_text("ply\n")
    with pytest.raises(InputError, match=r"frames of several formats \(obj, ply\); give a frame pattern"):
        open_sequence(tmp_path)


@pytest.mark.usefixtures("own_formats")
@pytest.mark.parametrize(("name", "extension"), [("obj", ".new"), ("new", ".npz")])
def test_two_formats_never_share_a_name_or_an_extension(name: str, extension: str):
    with pytest.raises(SettingsError, match="collides with"):
        register_format(Format(name=name, title="New", extensions=(extension,)))


def test_errors_of_array_code_name_the_file(tmp_path: Path):
    np.savez(tmp_path / "x.npz", points=TWO_FRAMES.points, faces=[[0, 1, 5]])
    with pytest.raises(InputError, match="face 0 refers to vertex 5") as caught:
        open_sequence(tmp_path / "x.npz")
    assert caught.value.path == str(tmp_path / "x.npz")
