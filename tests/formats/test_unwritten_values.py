"""Values that were never written are refused in HDF5, XDMF and Exodus, because libraries return zeros or fill
values for them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence
from tests.support.exodus_files import write_exodus

SHAPE = (3, 4, 3)


def sources(folder: Path, frames: int = 3) -> None:
    for number in range(frames):
        with h5py.File(folder / f"s{number}.h5", "w") as file:
            file["p"] = np.full(SHAPE[1:], number + 1, "f4")


def virtual(path: Path, name: str = "points", frames: int = 3, source: str = "s{}.h5") -> None:
    """Add a virtual dataset of three frames, of which the first `frames` have a source."""
    layout = h5py.VirtualLayout(SHAPE, "f4")
    for number in range(frames):
        layout[number] = h5py.VirtualSource(source.format(number), "p", SHAPE[1:])
    with h5py.File(path, "a") as file:
        file.create_virtual_dataset(name, layout)


def test_a_virtual_dataset_whose_sources_are_there_is_read(tmp_path: Path) -> None:
    sources(tmp_path)
    virtual(tmp_path / "x.h5")
    with h5py.File(tmp_path / "same.h5", "w") as file:
        file["a"] = np.ones(SHAPE, "f4")
        layout = h5py.VirtualLayout(SHAPE, "f4")
        layout[:] = h5py.VirtualSource(file["a"])
        file.create_virtual_dataset("points", layout)
    for name, expected in (("x.h5", [1, 2, 3]), ("same.h5", [1, 1, 1])):
        with open_sequence(tmp_path / name, fps=24) as read:
            assert read.read_frames(0, 3)[:, 0, 0].tolist() == expected


def test_growing_and_numbered_sources_are_counted(tmp_path: Path) -> None:
    none = h5py.h5s.UNLIMITED
    for number in range(3):
        with h5py.File(tmp_path / f"q{number}.h5", "w") as file:
            file["p"] = np.full((1, *SHAPE[1:]), number + 1, "f4")
    growing = h5py.h5s.create_simple(SHAPE, (none, *SHAPE[1:]))
    growing.select_hyperslab((0, 0, 0), (none, 1, 1), (1, 1, 1), (1, *SHAPE[1:]))
    made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    made.set_virtual(growing, b"q%b.h5", b"p", h5py.h5s.create_simple((1, *SHAPE[1:])))
    whole = h5py.h5s.create_simple(SHAPE, (none, *SHAPE[1:]))
    with h5py.File(tmp_path / "x.h5", "w", libver="latest") as file:
        h5py.h5d.create(file.id, b"points", h5py.h5t.IEEE_F32LE, whole, made)
    with open_sequence(tmp_path / "x.h5", fps=24) as read:
        assert read.read_frames(0, 3)[:, 0, 0].tolist() == [1, 2, 3]
    (tmp_path / "q1.h5").rename(tmp_path / "away")
    with pytest.raises(InputError, match=r"has its values in 'q1\.h5', which is missing"):
        open_sequence(tmp_path / "x.h5", fps=24)


def missing_source(path: Path) -> None:
    sources(path.parent, 2)
    virtual(path)


def uncovered(path: Path) -> None:
    sources(path.parent)
    virtual(path, frames=2)


def short_source(path: Path) -> None:
    sources(path.parent)
    with h5py.File(path.parent / "s1.h5", "w") as file:
        file["p"] = np.ones((2, 3), "f4")
    virtual(path)


def other_source(path: Path) -> None:
    sources(path.parent)
    with h5py.File(path.parent / "s1.h5", "w") as file:
        file["other"] = np.ones(SHAPE[1:], "f4")
    virtual(path)


def unwritten_source(path: Path) -> None:
    sources(path.parent)
    with h5py.File(path.parent / "s2.h5", "w") as file:
        file.create_dataset("p", SHAPE[1:], "f4", chunks=(2, 3))[:2] = 1
    virtual(path)


def unwritten_chunk(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("points", SHAPE, "f4", chunks=(1, 4, 3))[:2] = 1


def unwritten(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("points", SHAPE, "f4")


def unwritten_times(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["points"] = np.ones(SHAPE, "f4")
        file.create_dataset("times", (3,), "f8", chunks=(1,), maxshape=(None,))[0] = 1


def missing_raw_data(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("points", SHAPE, "f4", external=[("raw.bin", 0, h5py.h5f.UNLIMITED)])[:] = 1
    (path.parent / "raw.bin").unlink()


def missing_link(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["points"] = h5py.ExternalLink("away.h5", "/p")


def missing_faces(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["points"] = np.ones(SHAPE, "f4")
        file["faces"] = h5py.SoftLink("/nothing")


def unwritten_link(path: Path) -> None:
    with h5py.File(path.parent / "other.h5", "w") as file:
        file.create_dataset("p", SHAPE, "f4")
    with h5py.File(path, "w") as file:
        file["points"] = h5py.ExternalLink("other.h5", "/p")


def test_datasets_that_are_links_are_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["p"] = np.ones(SHAPE, "f4")
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["points"] = h5py.ExternalLink("other.h5", "/p")
    with open_sequence(tmp_path / "x.h5", fps=24) as read:
        assert read.read_frames(0, 3).min() == 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (missing_link, r"x\.h5: 'points' is a link to '/p' in 'away\.h5', which is missing"),
        (missing_faces, "'faces' is a link to '/nothing' in the file itself, which is missing"),
        (unwritten_link, r"other\.h5: dataset '/p' was never written"),
        (missing_source, r"x\.h5: dataset '/points' has its values in 's2\.h5', which is missing; restore that file"),
        (uncovered, "12 of 36 values of the virtual dataset '/points' have no source"),
        (short_source, r"s1\.h5: its dataset '/p' has 6 values, a virtual dataset needs 12 of it"),
        (other_source, r"s1\.h5: has no dataset 'p', which '/points' is made of"),
        (unwritten_source, r"s2\.h5: 1 of 2 chunks of dataset '/p' were never written"),
        (unwritten_chunk, "1 of 3 chunks of dataset '/points' were never written"),
        (unwritten, "dataset '/points' was never written"),
        (unwritten_times, "2 of 3 chunks of dataset '/times' were never written"),
        (missing_raw_data, r"has its values in 'raw\.bin', which is missing"),
    ],
)
def test_values_of_hdf5_that_are_not_there_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[[Path], None], message: str
) -> None:
    monkeypatch.chdir(tmp_path)  # HDF5 creates raw files in the current folder
    make(tmp_path / "x.h5")
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.h5", fps=24)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: virtual(path, "d"), r"has its values in 's0\.h5', which is missing"),
        (missing_link, r"h\.h5: '/points' is a link to '/p' in 'away\.h5', which is missing"),
        (unwritten_link, r"other\.h5: dataset '/p' was never written"),
        (unwritten_chunk, "1 of 3 chunks of dataset '/points' were never written"),
    ],
)
def test_values_of_xdmf_that_are_not_there_are_refused(
    tmp_path: Path, make: Callable[[Path], None], message: str
) -> None:
    make(tmp_path / "h.h5")
    with h5py.File(tmp_path / "h.h5") as file:
        name = next(iter(file))
    slab = '<DataItem Dimensions="3 3">0 0 0 1 1 1 1 4 3</DataItem>'
    (tmp_path / "x.xdmf").write_text(
        '<Xdmf><Domain><Grid><Topology TopologyType="Polyvertex"/><Geometry><DataItem ItemType="HyperSlab" '
        f'Dimensions="4 3">{slab}<DataItem Format="HDF" Dimensions="3 4 3">h.h5:/{name}</DataItem></DataItem>'
        "</Geometry></Grid></Domain></Xdmf>"
    )
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.xdmf")


def exodus_with(path: Path, **replaced: np.ndarray | None) -> None:
    """Write an Exodus file with some variables replaced; None creates a variable that is never written."""
    write_exodus(path, {"HEAT": np.zeros(3), "DISPLX": np.zeros(3)})
    with h5py.File(path, "a") as file:
        for name, values in replaced.items():
            shape = file[name].shape
            del file[name]
            if values is None:
                file.create_dataset(name, shape, "f8", chunks=(1, *shape[1:]), maxshape=(None, *shape[1:]))
            else:
                file[name] = values


MOVES = np.zeros((3, 4))


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({"vals_nod_var2": None}, "3 of 3 chunks of dataset '/vals_nod_var2' were never written"),
        ({"vals_nod_var2": MOVES[:1]}, "DISPLX has 1 steps, and there are 3 times"),
        ({"coordy": None}, "chunks of dataset '/coordy' were never written"),
        ({"coordy": np.array([0, 1, 9.969209968386869e36, 1])}, "coordy has values that were never written"),
    ],
)
def test_values_of_exodus_that_are_not_there_are_refused(
    tmp_path: Path, replaced: dict[str, np.ndarray | None], message: str
) -> None:
    exodus_with(tmp_path / "x.e", **replaced)
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.e")


def test_a_step_of_displacements_that_was_never_written_is_refused_by_frame(tmp_path: Path) -> None:
    moves = MOVES.copy()
    moves[2, 1] = 9.969209968386869e36
    exodus_with(tmp_path / "x.e", vals_nod_var2=moves)
    with open_sequence(tmp_path / "x.e") as read:
        assert read.read_frames(0, 2).shape == (2, 4, 3)
        with pytest.raises(InputError, match="frame 2: displacements along x were never written"):
            read.read_frames(1, 3)


def test_a_fill_value_of_its_own_and_of_netcdf_3_are_known(tmp_path: Path) -> None:
    moves = MOVES.copy()
    moves[1, 1] = -999
    exodus_with(tmp_path / "x.e", vals_nod_var2=moves)
    with h5py.File(tmp_path / "x.e", "a") as file:
        file["vals_nod_var2"].attrs["_FillValue"] = np.array([-999.0])
    with open_sequence(tmp_path / "x.e") as read, pytest.raises(InputError, match=r"frame 1: .* never written"):
        read.read_frames(0, 3)
    with netcdf_file(tmp_path / "y.e", "w") as file:
        for name, size in {"nodes": 3, "cells": 1, "corners": 3}.items():
            file.createDimension(name, size)
        for axis in "xyz":
            file.createVariable(f"coord{axis}", "d", ("nodes",))[:] = [0, 9.969209968386869e36, 1]
        block = file.createVariable("connect1", "i", ("cells", "corners"))
        block[:] = [[1, 2, 3]]
        block.elem_type = b"TRI3"
    with pytest.raises(InputError, match="coordx has values that were never written"):
        open_sequence(tmp_path / "y.e")
