"""What readers open: regular files, and of the files that a file names only those in its folder or in allowed folders.

Data outside these folders are never returned as positions, by whatever name or link, and no pipe makes a reader
wait.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

import h5py
import numpy as np
import pytest

from pdecodec import InputError, open_sequence
from pdecodec.cli.main import run
from pdecodec.formats import write_sequence
from pdecodec.formats.base.companions import input_files
from pdecodec.system.reading import FOLDERS_VARIABLE, FileScope, read_regular
from tests.support.exodus_files import write_exodus
from tests.support.scene_cases import needed, scene

SECRET = np.arange(12, dtype="<f4")
"""Content of a file outside the folder: the positions of four points."""

XDMF = """<Xdmf><Domain><Grid><Topology TopologyType="Polyvertex" NumberOfElements="4"/><Geometry>
<DataItem Format="{form}" NumberType="Float" Precision="4" Dimensions="4 3">{place}</DataItem>
</Geometry></Grid></Domain></Xdmf>"""

VTU = """<VTKFile type="UnstructuredGrid"><UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="1"><Points>
<DataArray type="Float32" NumberOfComponents="3" format="ascii">{0}</DataArray></Points><Cells>
<DataArray type="Int32" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">4</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">9</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>"""

USD_POINTS = """#usda 1.0
def Points "P"
{
    point3f[] points.timeSamples = { 0: [(0, 1, 2), (3, 4, 5), (6, 7, 8), (9, 10, 11)] }
}
"""

CLIPS = """#usda 1.0
def Points "P" (
    clips = { dictionary default = {
        asset[] assetPaths = [@{0}@]
        string primPath = "/P"
        double2[] active = [(0, 0)]
        double2[] times = [(0, 0)]
    } }
)
{
    point3f[] points
}
"""

Maker = Callable[[Path, str], Path]
"""A function that writes a file which refers to another path, and returns it."""


def gltf(folder: Path, place: str) -> Path:
    root: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": place, "byteLength": 48}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
        "meshes": [{"primitives": [{"mode": 0, "attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    (folder / "x.gltf").write_text(json.dumps(root))
    return folder / "x.gltf"


def text_file(name: str, text: str) -> Maker:
    def make(folder: Path, place: str) -> Path:
        (folder / name).write_text(text.replace("{0}", place))
        return folder / name

    return make


def hdf5(put: Callable[[h5py.File, str], None]) -> Maker:
    def make(folder: Path, place: str) -> Path:
        with h5py.File(folder / "x.h5", "w") as file:
            put(file, place)
        return folder / "x.h5"

    return make


def external_link(file: h5py.File, place: str) -> None:
    file["points"] = h5py.ExternalLink(place, "/points")


def link_behind_link(file: h5py.File, place: str) -> None:
    file["away"] = h5py.ExternalLink(place, "/")
    file["points"] = h5py.SoftLink("/away/points")


def link_of_a_neighbour(file: h5py.File, place: str) -> None:
    """A file that links to a file in the same folder, which in turn links to another place."""
    with h5py.File(Path(file.filename).with_name("between.h5"), "w") as other:
        other["points"] = h5py.ExternalLink(place, "/points")
    file["points"] = h5py.ExternalLink("between.h5", "/points")


def external_storage(file: h5py.File, place: str) -> None:
    file.create_dataset("points", (1, 4, 3), "<f4", external=[(place, 0, 48)])


def virtual(file: h5py.File, place: str) -> None:
    layout = h5py.VirtualLayout((1, 4, 3), "<f4")
    layout[:] = h5py.VirtualSource(place, "points", (1, 4, 3))
    file.create_virtual_dataset("points", layout)


def virtual_of_raw_data(file: h5py.File, place: str) -> None:
    external_storage(file, place)
    file.move("points", "raw")
    layout = h5py.VirtualLayout((1, 4, 3), "<f4")
    layout[:] = h5py.VirtualSource(".", "raw", (1, 4, 3))
    file.create_virtual_dataset("points", layout)


def exodus(folder: Path, place: str) -> Path:
    write_exodus(folder / "x.e", {})
    with h5py.File(folder / "x.e", "a") as file:
        for name in ("coordx", "coordy", "coordz"):
            del file[name]
        file["coord"] = h5py.ExternalLink(place, "/exodus")
    return folder / "x.e"


KINDS: dict[str, tuple[Maker, str]] = {
    "gltf": (gltf, "bin"),
    "xdmf binary": (text_file("x.xdmf", XDMF.format(form="Binary", place="{0}")), "bin"),
    "xdmf hdf": (text_file("x.xdmf", XDMF.format(form="HDF", place="{0}:/flat")), "h5"),
    "xdmf include": (
        text_file("x.xdmf", '<Xdmf xmlns:i="http://www.w3.org/2001/XInclude"><i:include href="{0}"/></Xdmf>'),
        "xdmf",
    ),
    "external link": (hdf5(external_link), "h5"),
    "link behind a link": (hdf5(link_behind_link), "h5"),
    "link of a neighbour": (hdf5(link_of_a_neighbour), "h5"),
    "external storage": (hdf5(external_storage), "bin"),
    "virtual dataset": (hdf5(virtual), "h5"),
    "virtual of raw data": (hdf5(virtual_of_raw_data), "bin"),
    "exodus": (exodus, "h5"),
    "pvd": (
        text_file("x.pvd", '<VTKFile><Collection><DataSet timestep="0" file="{0}"/></Collection></VTKFile>'),
        "vtu",
    ),
    "series": (text_file("x.vtu.series", '{"files": [{"name": "{0}"}]}'), "vtu"),
    "vtm": (
        text_file(
            "x.vtm",
            '<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet><DataSet index="0" file="{0}"/>'
            "</vtkMultiBlockDataSet></VTKFile>",
        ),
        "vtu",
    ),
    "pvtu": (
        text_file(
            "x.pvtu",
            '<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid><Piece Source="{0}"/></PUnstructuredGrid></VTKFile>',
        ),
        "vtu",
    ),
    "usd sublayer": (text_file("x.usda", "#usda 1.0\n(\n    subLayers = [@{0}@]\n)\n"), "usda"),
    "usd reference": (text_file("x.usda", '#usda 1.0\ndef "R" (\n    references = @{0}@</P>\n)\n{\n}\n'), "usda"),
    "usd clip": (text_file("x.usda", CLIPS), "usda"),
}


def secrets(folder: Path) -> None:
    """Write files of every kind outside the folder, which all hold the same points."""
    (folder / "secret.bin").write_bytes(SECRET.tobytes())
    with h5py.File(folder / "secret.h5", "w") as file:
        file["points"] = SECRET.reshape(1, 4, 3)
        file["flat"] = SECRET.reshape(4, 3)
        file["exodus"] = SECRET.reshape(4, 3).T
    numbers = " ".join(map(str, SECRET.tolist()))
    (folder / "secret.vtu").write_text(VTU.replace("{0}", numbers))
    (folder / "secret.usda").write_text(USD_POINTS)
    item = XDMF.format(form="XML", place=numbers)
    (folder / "secret.xdmf").write_text(item.removeprefix("<Xdmf>").removesuffix("</Xdmf>"))


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a project folder within a folder that holds secret files."""
    secrets(tmp_path)
    (tmp_path / "project").mkdir()
    return tmp_path / "project"


def needs(kind: str) -> None:
    if kind.startswith("usd"):
        needed("usd")


@pytest.mark.parametrize("way", ["below", "absolute", "link", "linked folder"])
@pytest.mark.parametrize("kind", KINDS)
def test_files_outside_the_folder_of_a_file_are_read_only_if_allowed(
    kind: str, way: str, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs(kind)
    make, extension = KINDS[kind]
    outside = project.parent / f"secret.{extension}"
    place = {
        "below": f"../{outside.name}",
        "absolute": str(outside),
        "link": outside.name,
        "linked folder": f"out/{outside.name}",
    }[way]
    if way == "link":
        (project / outside.name).symlink_to(outside)
    if way == "linked folder":
        (project / "out").symlink_to(project.parent)
    # HDF5 looks for raw data of a source of a virtual dataset in the current folder.
    monkeypatch.chdir(project)
    path = make(project, place)
    with pytest.raises(InputError) as caught:
        open_sequence(path)
    assert caught.value.code == "outside-folder"
    assert (caught.value.setting, caught.value.value) == ("asset_folders", str(project.parent))
    assert "--" not in str(caught.value)
    assert "\n" not in str(caught.value)
    with open_sequence(path, asset_folders=[project.parent]) as sequence:
        assert np.array_equal(sequence.read_frames(0, 1).reshape(-1), SECRET)
    monkeypatch.setenv(FOLDERS_VARIABLE, os.pathsep.join(["/nowhere", str(project.parent)]))
    with open_sequence(path) as sequence:
        assert sequence.frame_count == 1


@pytest.mark.parametrize("kind", KINDS)
def test_files_in_the_folder_or_below_are_read(kind: str, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needs(kind)
    make, extension = KINDS[kind]
    (project / "below").mkdir()
    secrets(project / "below")
    monkeypatch.chdir(project)
    with open_sequence(make(project, f"below/secret.{extension}")) as sequence:
        assert np.array_equal(sequence.read_frames(0, 1).reshape(-1), SECRET)


@pytest.mark.parametrize("kind", KINDS)
def test_a_pipe_that_a_file_names_is_refused_without_waiting_for_it(
    kind: str, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs(kind)
    make, extension = KINDS[kind]
    pipe = project / f"pipe.{extension}"
    os.mkfifo(pipe)
    monkeypatch.chdir(project)
    with freed(pipe) as waited, pytest.raises(InputError, match="is a pipe, but only regular files can be read"):
        open_sequence(make(project, pipe.name))
    assert not waited


@contextmanager
def freed(pipe: Path) -> Iterator[list[bool]]:
    """Within this block, end the wait of a process that opens a pipe, and record it in the list."""
    waited: list[bool] = []
    is_over = Event()

    def free() -> None:
        while not is_over.wait(0.5):
            with contextlib.suppress(OSError):  # nothing is waiting
                os.close(os.open(pipe, os.O_WRONLY | os.O_NONBLOCK))
                waited.append(True)

    thread = Thread(target=free)
    thread.start()
    try:
        yield waited
    finally:
        is_over.set()
        thread.join()


NAMED = ["x.gltf", "x.glb", "x.xdmf", "x.h5", "x.e", "x.npz", "x.abc", "x.usda", "x.pvd", "x.vtu", "x.series", "x.ply"]
NAMED += ["x.stl", "x.off", "x.obj", "x.mdd", "x.pc2", "x.pdeanim", "x"]


@pytest.mark.parametrize("name", NAMED)
def test_a_pipe_that_is_named_itself_is_refused(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / name)
    for isolate in (False, True) if name == "x.abc" else (False,):
        with pytest.raises(InputError, match="is a pipe, but only regular files can be read") as caught:
            open_sequence(tmp_path / name, isolate=isolate)
        assert caught.value.path == str(tmp_path / name)
    assert run(["encode", str(tmp_path / name), "-o", str(tmp_path / "y.pdeanim")]) == 3
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs /dev/zero")
def test_a_device_is_refused_before_it_is_opened() -> None:
    with pytest.raises(InputError, match="/dev/zero: is a device, but only regular files can be read; copy it to one"):
        open_sequence("/dev/zero")


def test_no_more_of_a_buffer_is_read_than_is_declared(project: Path) -> None:
    with (project / "large.bin").open("wb") as file:
        file.write(SECRET.tobytes())
        file.truncate(2**40)  # takes no room on disk, but would take more memory than there is
    with open_sequence(gltf(project, "large.bin")) as sequence:
        assert np.array_equal(sequence.read_frames(0, 1).reshape(-1), SECRET)
    assert read_regular(project / "large.bin", 48) == SECRET.tobytes()
    # Declaring a length must not take memory either.
    scope = FileScope(project / "x.gltf")
    assert len(scope.read("../project/x.gltf", 2**62)) == (project / "x.gltf").stat().st_size


@pytest.mark.parametrize("uri", ["a%00b.bin", "a\0b.bin", "\ud800.bin", "a" * 5000 + ".bin", ".", "no/such/file.bin"])
def test_a_name_that_no_file_has_is_refused_in_one_line(uri: str, project: Path) -> None:
    path = gltf(project, uri)
    with pytest.raises(InputError) as caught:
        open_sequence(path)
    assert caught.value.path == str(path)
    assert len(str(caught.value)) < len(str(path)) + 400
    assert input_files(str(path)) == (path,)


def test_a_symlinked_file_may_name_files_in_its_folder_and_in_that_of_its_target(project: Path) -> None:
    (project / "store").mkdir()
    (project / "shot").mkdir()
    secrets(project / "store")
    made = gltf(project / "store", "secret.bin")
    (project / "shot" / "x.gltf").symlink_to(made)
    (project / "shot" / "secret.bin").symlink_to(project / "store" / "secret.bin")
    with open_sequence(project / "shot" / "x.gltf") as sequence:
        assert np.array_equal(sequence.read_frames(0, 1).reshape(-1), SECRET)


def test_a_loop_of_links_is_refused(project: Path) -> None:
    (project / "loop.bin").symlink_to(project / "loop.bin")
    with pytest.raises(InputError, match=r"names 'loop\.bin', which cannot be read"):
        open_sequence(gltf(project, "loop.bin"))
    path = hdf5(lambda file, place: file.__setitem__("points", h5py.ExternalLink("x.h5", "/points")))(project, "")
    with pytest.raises(InputError, match="is behind more than 16 links"):
        open_sequence(path)


def test_the_command_line_names_its_option_and_takes_it(
    project: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, out = gltf(project, "../secret.bin"), project / "x.pdeanim"
    assert run(["encode", str(path), "-o", str(out)]) == 3
    assert f"is not read; pass --assets {project.parent} if you trust the file" in capsys.readouterr().err
    monkeypatch.chdir(project)
    assert run(["encode", str(path), "-o", str(out), "--assets", ".."]) == 0
    assert run(["info", str(path), "--assets", "..", "--isolate"]) == 0
    assert run(["compare", str(path), str(out), "--assets", ".."]) == 0
    assert run(["compare", str(path), str(out)]) == 3
    # Inputs are recognised by their resolved path, so no output overwrites them.
    assert run(["convert", str(path), "-o", "../secret.h5", "--assets", "..", "--overwrite"]) == 0
    capsys.readouterr()
    (project / "clips.json").write_text(json.dumps([{"source": "x.gltf", "asset_folders": [".."]}]))
    assert run(["batch", "clips.json", "-o", "done"]) == 0


def test_a_package_takes_no_file_from_outside_with_it(project: Path) -> None:
    needed("usd")
    from pdecodec.formats import write_onto

    (project / "x.usda").write_text(USD_POINTS.replace("{\n", "{\n    asset look = @../secret.bin@\n", 1))
    with open_sequence(project / "x.usda") as clip:
        with pytest.raises(InputError, match="which lies outside its folder"):
            write_onto(clip, project / "x.usda", project / "y.usdz")
        write_onto(clip, project / "x.usda", project / "y.usdz", asset_folders=[project.parent])
    assert SECRET.tobytes() in (project / "y.usdz").read_bytes()


def test_standard_input_that_is_not_an_animation_is_not_copied(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pdecodec", "decode", "-", "-o", str(tmp_path / "x.npz")]
    with Path("/dev/zero").open("rb") as zeros:
        done = subprocess.run(command, stdin=zeros, capture_output=True, text=True, timeout=60)
    assert done.returncode == 4
    assert done.stderr.count("\n") == 1
    assert "standard input, byte 0: not a .pdeanim file" in done.stderr


def test_a_clip_written_by_us_names_nothing_outside(tmp_path: Path) -> None:
    for name in ("x.gltf", "x.xdmf", "x.pvd"):
        write_sequence(scene(), tmp_path / name)
        with open_sequence(tmp_path / name) as sequence:
            assert sequence.frame_count == scene().frame_count


def test_data_in_the_file_itself_need_no_folder(tmp_path: Path) -> None:
    uri = "data:application/octet-stream;base64," + base64.b64encode(SECRET.tobytes()).decode()
    with open_sequence(gltf(tmp_path, uri)) as sequence:
        assert np.array_equal(sequence.read_frames(0, 1).reshape(-1), SECRET)
