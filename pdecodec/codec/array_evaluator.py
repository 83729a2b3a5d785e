"""Evaluate with any array library, on its device: on a GPU, a frame then costs one product of arrays that are
already on the device.

For a group of frames, a quantity at a time is the sum over functions of time of weights times fields. Weights depend
on the time alone, fields do not depend on it. Positions add the reference frame and corrections of single vertices.
Fields are copied to the device once per group; weights, some hundred numbers, for every time.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from itertools import groupby
from typing import Any, Generic, Literal, NamedTuple, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.codec.decoder import ACCELERATIONS, POSITIONS, VELOCITIES, Animation
from pdecodec.codec.opening import ChangingAnimation
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.times import Outside

Value = TypeVar("Value")
Quantity = Literal["positions", "velocities", "accelerations"]

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
"""Quantities, by the core's numbers."""

GROUPS_KEPT = 4
"""Number of groups whose fields stay on the device: the two that contribute between frames, and the next one."""

FRAMES_KEPT = 4
"""Number of frames whose corrections stay on the device: the frames before and after a time, and the next ones."""


class Corrections(NamedTuple):
    """Corrections of single vertices at the frames of a group: frame, vertex and offset of each.

    Attributes
    ----------
    frames : (n,) int64
        Frame of the file, in order.
    vertices : (n,) int32
        Each vertex at most once per frame.
    offsets : (n, 3) float32 [scene units]
    """

    frames: Int64Array
    vertices: Int32Array
    offsets: Float32Array


class ArrayEvaluator:
    """Positions, velocities and accelerations of an animation, computed by another array library.

    They equal those of the animation except for float32 sums in another order, which may exceed the file's bound.
    Only one thread at a time may use it.

    Parameters
    ----------
    animation : Animation
        Stays the caller's, and open.
    library : module
        A module with the functions of the array API standard that are needed here: ``numpy``, ``torch``, ``cupy``,
        ``jax.numpy``, ``array_api_strict``.
    device : optional
        A device of the library (``"cuda"``). Default: the library's.
    groups_kept : int
        Number of groups whose fields stay on the device.

    Raises
    ------
    SettingsError
        If the animation has several runs: take one of its :attr:`runs`.
    """

    def __init__(
        self, animation: Animation, library: Any, *, device: Any = None, groups_kept: int = GROUPS_KEPT
    ) -> None:
        if isinstance(animation, ChangingAnimation):
            raise SettingsError("has several runs of frames; take one of its runs", path=animation.path)
        self._animation, self._library = animation, library
        self._place = {} if device is None else {"device": device}
        self._factors = _Kept[Any](groups_kept)
        self._corrections = _Kept[Corrections](groups_kept)
        self._added = _Kept[Any](FRAMES_KEPT)
        self._group_edges = animation.group_edges
        reference, _ = animation.reference_and_space()
        self._reference = self._there(reference.points)

    def positions(self, times: ArrayLike, *, outside: Outside = "clamp") -> Any:
        """Return positions at one time or at several.

        Parameters
        ----------
        times : float or (n,) array [s]
            In any order.
        outside : {"clamp", "loop", "refuse"}
            As :meth:`Animation.positions` has it.

        Returns
        -------
        (vertices, 3) or (n, vertices, 3) array of float32 [scene units]

        Raises
        ------
        SettingsError
            If a time is not a number, or lies outside and that is refused.
        CorruptFileError
            If a group that is needed is damaged.
        """
        return self._evaluate(POSITIONS, times, outside)

    def velocities(self, times: ArrayLike, *, outside: Outside = "clamp") -> Any:
        """Return velocities at one time or at several [scene units / s], as :meth:`Animation.velocities`."""
        return self._evaluate(VELOCITIES, times, outside)

    def accelerations(self, times: ArrayLike, *, outside: Outside = "clamp") -> Any:
        """Return accelerations at one time or at several [scene units / s^2], as :meth:`Animation.accelerations`."""
        return self._evaluate(ACCELERATIONS, times, outside)

    def fields(self, group: int) -> Any:
        """Return the fields of a group, one per function of time; every call copies them to the device.

        Parameters
        ----------
        group : int
            From 0; :attr:`Animation.group_edges` gives its frames.

        Returns
        -------
        (functions, vertices, axes) array of float32 [scene units]
            3 axes, or 1 that all axes share.

        Raises
        ------
        SettingsError
            If no group of this number.
        CorruptFileError
            If it is damaged.
        """
        return self._there(self._fields(group))

    def weights(self, time: float, group: int, *, quantity: Quantity = "positions") -> Float64Array:
        """Return the weight of each function of time of a group at a time; 0 if the group does not contribute.

        Parameters
        ----------
        time : float [s]
        group : int
        quantity : {"positions", "velocities", "accelerations"}

        Returns
        -------
        (functions, 1) or (functions, 3) float64 [1, 1 / s or 1 / s^2]
            3 axes where fields have 1, and 1 where they have 3: their product has 3.

        Raises
        ------
        SettingsError
            If the time is not a number, or no group of this number or quantity.
        CorruptFileError
            If the group is damaged.
        """
        if quantity not in QUANTITIES:
            raise SettingsError(f"must be one of {', '.join(QUANTITIES)}, not {quantity!r}", setting="quantity")
        if np.isnan(time):
            raise SettingsError("must be a number or a list of numbers", setting="times")
        return self._weights(QUANTITIES.index(quantity), time, group)

    def corrections(self, group: int) -> Corrections:
        """Return the corrections at the frames of a group. Between two frames the corrections of both count,
        weighted by time.

        Raises
        ------
        SettingsError
            If no group of this number.
        CorruptFileError
            If it is damaged.
        """
        self._check(group)

        def found() -> Corrections:
            with self._animation._naming_the_file():
                return Corrections(*self._animation._core.corrections(group))

        return self._corrections.get(group, found)

    def _check(self, group: int) -> None:
        count = len(self._group_edges) - 1
        if not 0 <= group < count:
            raise SettingsError(f"there is no group {group}; the file has {count}, from 0 on", code="unknown-name")

    def _fields(self, group: int) -> Float32Array:
        self._check(group)
        with self._animation._naming_the_file():
            return self._animation._core.fields(group)

    def _weights(self, quantity: int, time: float, group: int) -> Float64Array:
        self._check(group)
        with self._animation._naming_the_file():
            return self._animation._core.weights(quantity, time, group).T

    def _there(self, values: NDArray[Any]) -> Any:
        """Copy an array to the device as float32. Some libraries would keep using the memory of the array itself."""
        own = np.array(values, np.float32, order="C")
        return self._library.asarray(own, dtype=self._library.float32, **self._place)

    def _evaluate(self, quantity: int, times: ArrayLike, outside: Outside) -> Any:
        asked = np.atleast_1d(np.asarray(times, np.float64))
        inside = self._animation._inside(asked, outside)
        # The core clamps times itself, and returns zero velocities outside the clip.
        wanted = (asked if outside == "clamp" else inside).tolist()
        parts = [
            self._of_groups(quantity, list(some), range(*groups))
            for groups, some in groupby(wanted, lambda time: self._groups_at(quantity, time))
        ]
        if not parts:
            return self._there(np.empty((0, self._animation.vertex_count, 3)))
        join = getattr(self._library, "concat", None) or self._library.concatenate
        found = parts[0] if len(parts) == 1 else join(parts)
        return found if np.ndim(times) else found[0, ...]

    def _groups_at(self, quantity: int, time: float) -> tuple[int, int]:
        with self._animation._naming_the_file():
            return self._animation._core.groups_at(quantity, time)

    def _of_groups(self, quantity: int, times: list[float], groups: range) -> Any:
        """Return a quantity at times to which the same groups contribute: (times, vertices, 3)."""
        xp, shape = self._library, (len(times), self._animation.vertex_count, 3)
        found = xp.broadcast_to(self._reference if quantity == POSITIONS else xp.zeros_like(self._reference), shape)
        for group in groups:
            weights = np.stack([self._weights(quantity, time, group) for time in times])
            if weights.shape[1] == 0:
                continue
            factor = self._factors.get(group, partial(self._factor, group))
            if weights.shape[2] == 1:
                moved = xp.reshape(xp.matmul(self._there(weights[..., 0]), factor), shape)
            else:
                moved = xp.matmul(factor, self._there(weights))
            found = found + moved
        added = [self._correction(quantity, time) for time in times]
        if all(one is None for one in added):
            return found
        still = xp.zeros_like(self._reference)
        return found + xp.stack([still if one is None else one for one in added])

    def _factor(self, group: int) -> Any:
        """Return fields in the shape of the product: (functions, vertices * 3), or with one axis (vertices,
        functions).
        """
        fields = self._fields(group)
        return self._there(fields.reshape(len(fields), -1) if fields.shape[2] == 3 else fields[..., 0].T)

    def _correction(self, quantity: int, time: float) -> Any:
        """Return the corrections of all vertices at a time, (vertices, 3), or None."""
        times = self._animation.times
        after = min(int(np.searchsorted(times, time, "right")), len(times) - 1)
        before = max(after - 1, 0)
        step = float(times[after] - times[before])
        if quantity == POSITIONS:
            share = min(max((time - float(times[before])) / step, 0.0), 1.0) if step else 0.0
            shares = {before: 1.0 - share, after: share} if step else {before: 1.0}
        elif quantity == VELOCITIES and step and times[0] <= time <= times[-1]:
            shares = {before: -1.0 / step, after: 1.0 / step}
        else:
            return None
        parts = [
            share * added
            for frame, share in shares.items()
            if share and (added := self._added.get(frame, partial(self._correction_at, frame))) is not None
        ]
        return sum(parts[1:], start=parts[0]) if parts else None

    def _correction_at(self, frame: int) -> Any:
        """Return the corrections of all vertices at a frame on the device, (vertices, 3), or None."""
        rows = self.corrections(bisect_right(self._group_edges, frame) - 1)
        begin, end = np.searchsorted(rows.frames, [frame, frame + 1])
        if begin == end:
            return None
        xp, count = self._library, self._animation.vertex_count
        order = begin + np.argsort(rows.vertices[begin:end])
        every = xp.arange(count, **self._place)
        # Padding with an extra vertex after the last one, which `searchsorted` returns for vertices without a
        # correction.
        lacking = xp.asarray(np.append(rows.vertices[order], count), dtype=every.dtype, **self._place)
        offsets = self._there(np.append(rows.offsets[order], np.zeros((1, 3)), axis=0).ravel())
        at = xp.searchsorted(lacking, every)
        places = xp.reshape(at, (count, 1)) * 3 + xp.arange(3, dtype=at.dtype, **self._place)
        found = xp.reshape(xp.take(offsets, xp.reshape(places, (3 * count,))), (count, 3))
        is_lacking = xp.reshape(xp.take(lacking, at) == every, (count, 1))
        return xp.where(is_lacking, found, xp.zeros_like(found))


class _Kept(Generic[Value]):
    """A cache of the most recent values, by number."""

    def __init__(self, count: int) -> None:
        self._count, self._values = max(1, count), OrderedDict[int, Value]()

    def get(self, number: int, make: Callable[[], Value]) -> Value:
        if number not in self._values:
            self._values[number] = make()
            while len(self._values) > self._count:
                self._values.popitem(last=False)
        self._values.move_to_end(number)
        return self._values[number]
