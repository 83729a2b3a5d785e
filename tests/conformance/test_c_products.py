"""The C interface's fields, weights and corrections, from which a graphics processor computes positions."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec import Animation, open_animation
from pdecodec.errors import PdecodecError
from pdecodec.mesh.arrays import Float64Array
from spec.sealing import take_apart
from spec.vector_files import accepted_files, accepted_vectors
from tests.conformance.test_c_interface import Error, installed, library_of

__all__ = ["installed"]

QUANTITIES = ("positions", "velocities", "accelerations")
OUTSIDE = 1.0
"""How far times lie before the first frame and after the last one [s]."""


class Group(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_int64) for name in ("first_frame", "frame_count", "function_count", "axis_count"))


class Section(ctypes.Structure):
    _fields_ = (("type", ctypes.c_char_p), ("offset", ctypes.c_uint64), ("length", ctypes.c_uint64))


SINGLE = float(np.finfo(np.float32).eps)

CORRECTION = np.dtype([("frame", np.int32), ("vertex", np.int32), ("offset", np.float32, 3)])


class OpenFile:
    """A file with a single run, opened through ctypes."""

    def __init__(self, library: ctypes.CDLL, handle: ctypes.c_void_p) -> None:
        self.library, self.handle, self.error = library, handle, Error()
        self.vertices = self.count("vertex")
        self.groups = [self.group(index) for index in range(self.count("group"))]

    def count(self, what: str) -> int:
        function = getattr(self.library, f"pdeanim_{what}_count")
        function.restype = ctypes.c_int64
        return int(function(self.handle))

    def call(self, name: str, *arguments: object) -> None:
        status = getattr(self.library, f"pdeanim_{name}")(self.handle, *arguments, ctypes.byref(self.error))
        if status != 0:
            raise PdecodecError(self.error.text.decode())

    def group(self, index: int) -> Group:
        found = Group()
        self.call("get_group", ctypes.c_int64(index), ctypes.byref(found))
        return found

    def sections(self) -> list[Section]:
        found = []
        for index in range(self.count("section")):
            found.append(Section())
            self.call("get_section", ctypes.c_int64(index), ctypes.byref(found[-1]))
        return found

    def array(self, shape: tuple[int, ...], dtype: type, name: str, *arguments: object) -> NDArray[np.generic]:
        out = np.empty(shape, dtype)
        self.call(name, *arguments, ctypes.c_void_p(out.ctypes.data))
        return out

    def groups_at(self, quantity: int, time: float) -> range:
        first, count = ctypes.c_int64(), ctypes.c_int64()
        self.call("groups_at", quantity, ctypes.c_double(time), ctypes.byref(first), ctypes.byref(count))
        return range(first.value, first.value + count.value)

    def weights(self, quantity: int, time: float, index: int) -> Float64Array:
        """Return the weights of a group's functions, (functions, axes)."""
        group = self.groups[index]
        shape = (1 if group.axis_count == 3 else 3, group.function_count)
        found = self.array(shape, np.float64, "weights", quantity, ctypes.c_double(time), ctypes.c_int64(index))
        return found.astype(np.float64).T

    def fields(self, index: int) -> Float64Array:
        """Return the fields of a group, (functions, vertices, axes)."""
        group = self.groups[index]
        shape = (group.function_count, self.vertices, group.axis_count)
        return self.array(shape, np.float32, "fields", ctypes.c_int64(index)).astype(np.float64)

    def corrections(self, index: int) -> NDArray[np.void]:
        place, count = ctypes.c_void_p(), ctypes.c_int64()
        self.call("corrections", ctypes.c_int64(index), ctypes.byref(place), ctypes.byref(count))
        if not count.value:
            return np.empty(0, CORRECTION)
        assert place.value is not None
        rows = (ctypes.c_char * (count.value * CORRECTION.itemsize)).from_address(place.value)
        return np.frombuffer(bytes(rows), CORRECTION)


@contextmanager
def opened(installed: Path, data: bytes, run: int | None = None) -> Iterator[OpenFile]:
    """Open a file, or one run of it."""
    library = ctypes.CDLL(os.fspath(library_of(installed)))
    handle, error = ctypes.c_void_p(), Error()
    arguments = (ctypes.c_char_p(data), ctypes.c_size_t(len(data)), None, ctypes.byref(handle), ctypes.byref(error))
    assert library.pdeanim_open_memory(*arguments) == 0, error.text
    whole = handle.value
    if run is not None:
        assert library.pdeanim_open_run(handle, ctypes.c_int64(run), ctypes.byref(handle), ctypes.byref(error)) == 0
        library.pdeanim_close(ctypes.c_void_p(whole))
    yield OpenFile(library, handle)
    library.pdeanim_close(handle)


def correction_at(file: OpenFile, frame: int) -> Float64Array:
    """Return the corrections of all vertices at a frame, (vertices, 3)."""
    index = next(i for i, own in enumerate(file.groups) if own.first_frame + own.frame_count > frame)
    added = np.zeros((file.vertices, 3))
    for row in file.corrections(index):
        if row["frame"] == frame:
            assert not added[row["vertex"]].any(), "one a vertex"
            added[row["vertex"]] = row["offset"]
    return added


def product(file: OpenFile, times: Float64Array, quantity: int, time: float) -> tuple[Float64Array, float]:
    """Compute a quantity at a time as the header describes, (vertices, 3), and the largest term of its sums."""
    found, largest = np.zeros((file.vertices, 3)), 0.0
    for index in file.groups_at(quantity, time):
        fields, weights = file.fields(index), file.weights(quantity, time, index)
        found += np.einsum("fva,fa->va", fields, weights)
        largest += float(np.einsum("fva,fa->va", np.abs(fields), np.abs(weights)).max())
    after = min(int(np.searchsorted(times, time, "right")), len(times) - 1)
    before = max(after - 1, 0)
    step = float(times[after] - times[before])
    added = np.stack([correction_at(file, before), correction_at(file, after)])
    shares = np.zeros(2)
    if quantity == 0:
        found += file.array((file.vertices, 3), np.float32, "reference")
        share = np.clip((time - times[before]) / step, 0, 1) if step else 0.0
        shares = np.array([1 - share, share])
    elif quantity == 1 and step and times[0] <= time <= times[-1]:
        shares = np.array([-1, 1]) / step
    found += np.einsum("kva,k->va", added, shares)
    largest += float(np.einsum("kva,k->va", np.abs(added), np.abs(shares)).max())
    return found, largest


def times_of(animation: Animation) -> list[float]:
    """Return times of frames, between them, and before and after all."""
    frames = animation.times
    between = frames[:-1] + 0.3 * np.diff(frames)
    return [frames[0] - OUTSIDE, *frames[:9], *between[:9], *frames[-3:], *between[-3:], frames[-1] + OUTSIDE]


@pytest.mark.parametrize("path", accepted_files().values(), ids=lambda path: path.stem)
def test_fields_weights_and_corrections_add_up_to_what_is_evaluated(installed: Path, path: Path) -> None:
    with open_animation(path) as animation:
        for index, run in enumerate(animation.runs):
            assert isinstance(run, Animation)
            with opened(installed, path.read_bytes(), index) as file:
                for quantity, name in enumerate(QUANTITIES):
                    for time in times_of(run):
                        expected = getattr(run, name)(time).astype(np.float64)
                        found, largest = product(file, run.times, quantity, time)
                        # Both add up one number per function in single precision, each in its own order.
                        margin = 3 * SINGLE * (largest + np.abs(expected).max() + np.abs(run.positions(time)).max())
                        assert np.abs(found - expected).max() <= margin, (name, time)


def test_groups_that_do_not_count_have_weights_of_zero(installed: Path) -> None:
    data = accepted_vectors()["groups"]
    with opened(installed, data) as file, open_animation(data) as animation:
        assert len(file.groups) > 2
        last = len(file.groups) - 1
        assert list(file.groups_at(0, animation.times[-1])) == [last]
        assert not file.weights(0, animation.times[-1], 0).any()
        assert file.weights(0, animation.times[-1], last).any()


def test_each_vertex_is_of_one_element_and_sections_are_where_the_table_puts_them(installed: Path) -> None:
    data = accepted_vectors()["many_patches"]
    with opened(installed, data) as file:
        elements = file.array((file.vertices,), np.int32, "elements")
        assert np.unique(elements).tolist() == list(range(int(elements.max()) + 1))
        assert elements.max() > 0
        found = [(one.type.decode(), data[one.offset :][: one.length]) for one in file.sections()]
    assert found == [(part.kind, part.content) for part in take_apart(data)]


def test_arguments_out_of_range_are_refused_by_name(installed: Path) -> None:
    with opened(installed, accepted_vectors()["groups"]) as file:
        beyond = ctypes.c_int64(len(file.groups))
        out = ctypes.c_void_p(np.empty(1).ctypes.data)
        for name, arguments in (
            ("get_group", (beyond, out)),
            ("fields", (beyond, out)),
            ("weights", (0, ctypes.c_double(0.0), beyond, out)),
            ("corrections", (beyond, out, out)),
        ):
            with pytest.raises(PdecodecError, match=f"there is no group {beyond.value}"):
                file.call(name, *arguments)
        with pytest.raises(PdecodecError, match="times must be numbers"):
            file.groups_at(0, float("nan"))
        with pytest.raises(PdecodecError, match="unknown quantity"):
            file.groups_at(3, 0.0)
    with opened(installed, accepted_vectors()["runs"]) as file:
        assert file.groups == []
        with pytest.raises(PdecodecError, match="open one of them"):
            file.call("reference", out)
