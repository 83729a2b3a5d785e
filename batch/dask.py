"""Clips in users' own Dask graphs (extra ``dask``): tasks that encode, and arrays of decoded values.

The command `batch` does everything that a batch needs; this module is for graphs that process clips further::

    import dask
    import pdecodec.dask

    results = dask.compute(*pdecodec.dask.encode_clips("shots/**/*.abc", "/studio/coded", tolerance=1e-4))
    heights = pdecodec.dask.positions("/studio/coded/walk.pdeanim")[:, :, 1].max(axis=1).compute()
"""

from __future__ import annotations

import json
import os
from functools import lru_cache
from typing import TYPE_CHECKING, Any
from weakref import finalize

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.codec.decoder import Animation
from pdecodec.codec.opening import ChangingAnimation, open_animation
from pdecodec.codec.source import DecodeLimits
from pdecodec.errors import MissingExtraError, SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.system.storage import RemoteFile, is_address

if TYPE_CHECKING:
    from dask.array import Array
    from dask.delayed import Delayed

OPEN_AT_ONCE = 8
"""Files that a process keeps open for their next block: opening a file decodes its mesh."""


def encode_clips(
    given: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    verify: bool = False,
    max_memory: int | None = None,
    **options: Any,
) -> list[Delayed]:
    """Return one task per clip of a manifest, a pattern or a folder, each as ``pdecodec batch`` does it.

    Parameters
    ----------
    given : path
        As in :func:`pdecodec.batch.clips_of`. The workers must see its paths under the same names.
    folder : path or address
        The folder for files and records; a clip whose file is there with the same options is kept.
    overwrite : bool
        Whether to replace files that are not of an earlier run.
    verify : bool
        Decode every file and measure its error against the source.
    max_memory : int, optional [bytes]
        Estimated memory that clips encoded at once in one process may take. Default: most of the
        memory of the process.
    **options
        Options for clips whose manifest does not set them, by the names of :class:`pdecodec.batch.ClipOptions` and of
        the settings of :func:`pdecodec.encode`.

    Returns
    -------
    list of dask.delayed.Delayed
        In order; the value of each is a :class:`pdecodec.batch.Result`, also for a clip that failed.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    InputError, SettingsError
        If there is no clip, an option is wrong, or the folder cannot be created.
    """
    from pdecodec.batch import ClipOptions, Work, clips_of
    from pdecodec.batch.cluster import absolute, do_on_worker, seen_by_all

    try:
        from dask.delayed import delayed
    except ImportError as error:
        raise _missing(error) from error
    clips = clips_of(given, ClipOptions().with_values(options))
    work = seen_by_all(Work(folder=os.fspath(folder), overwrite=overwrite, verify=verify))
    task = delayed(do_on_worker, pure=False)
    return [task(absolute(clip), work, max_memory) for clip in clips]


def positions(
    source: str | os.PathLike[str],
    times: ArrayLike | None = None,
    *,
    block: int | None = None,
    limits: DecodeLimits | None = None,
) -> Array:
    """Return decoded positions as a Dask array; each block reads and decodes only the groups of frames that it needs.

    Parameters
    ----------
    source : path or address
        The file; the workers must see it under the same name.
    times : (n,) array [s], optional
        In any order. Times before the first frame or after the last one are clamped. Default: those of the frames.
    block : int, optional
        Times per block. Default: those of a group of frames, or all if `times` is given.
    limits : DecodeLimits, optional

    Returns
    -------
    (n, vertices, 3) dask.array.Array of float32 [scene units]

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    InputError, CorruptFileError
        As in :func:`pdecodec.open`.
    SettingsError
        If the number of vertices changes within the file, or times are not numbers.
    """
    return _decoded(None, source, times, block, limits)


def field(
    source: str | os.PathLike[str],
    name: str,
    times: ArrayLike | None = None,
    *,
    block: int | None = None,
    limits: DecodeLimits | None = None,
) -> Array:
    """Return the values of a field as a Dask array; each block reads only the chunks of the field that it needs.

    Parameters
    ----------
    source : path or address
        The file; the workers must see it under the same name.
    name : str
        Name of a field, one of :attr:`pdecodec.Animation.fields`.
    times, block, limits
        As in :func:`positions`.

    Returns
    -------
    (n, rows) or (n, rows, components) dask.array.Array of the field's type

    Raises
    ------
    MissingExtraError, CorruptFileError, SettingsError
        As in :func:`positions`.
    InputError
        As in :func:`pdecodec.open`, and if there is no such field.
    """
    return _decoded(name, source, times, block, limits)


def _decoded(
    name: str | None,
    source: str | os.PathLike[str],
    times: ArrayLike | None,
    block: int | None,
    limits: DecodeLimits | None,
) -> Array:
    """Return a field, or positions without a name, as a Dask array."""
    try:
        from dask.array import from_array
    except ImportError as error:
        raise _missing(error) from error
    if block is not None and block < 1:
        raise SettingsError(f"must be 1 or more, not {block}", setting="block")
    place = os.fspath(source) if is_address(source) else os.path.abspath(source)
    with open_animation(place, limits=limits) as animation:
        if isinstance(animation, ChangingAnimation):
            raise SettingsError("has frames of several meshes, which do not fit one array; use its runs", path=source)
        asked = animation.times if times is None else np.asarray(times, np.float64)
        if asked.ndim != 1 or np.isnan(asked).any():
            raise SettingsError("must be a list of numbers", setting="times")
        edges, dtype = animation.group_edges, np.dtype(np.float32)
        shape: tuple[int, ...] = (animation.vertex_count, 3)
        if name is not None:
            found = animation.field_named(name)
            dtype, shape = found.dtype, found.shape(0, animation.objects)[1:]
        if block is not None or times is not None:
            edges = [*range(0, asked.size, block or max(1, asked.size)), asked.size]
    sizes = tuple(np.diff(edges).tolist()) or (0,)
    axes = list(range(1, len(shape) + 1))
    return from_array(asked, chunks=(sizes,)).map_blocks(
        _block, name, place, _version_of(place), limits, chunks=(sizes, *((size,) for size in shape)), new_axis=axes,
        dtype=dtype, meta=np.empty((0,) * (1 + len(shape)), dtype),
    )  # fmt: skip


def _block(
    times: Float64Array, name: str | None, place: str, version: str, limits: DecodeLimits | None
) -> NDArray[Any]:
    animation = _kept_open(place, version, limits)
    return animation.sample(times) if name is None else animation.field(name, times)


@lru_cache(OPEN_AT_ONCE)
def _kept_open(place: str, version: str, limits: DecodeLimits | None) -> Animation:
    """Return an open animation. It is closed after the cache has dropped it and no thread uses it any more."""
    animation = open_animation(place, limits=limits)
    finalize(animation, animation._source.close)
    return animation


def _version_of(place: str) -> str:
    """Return a text that changes when the file is replaced, so that it is opened again."""
    if is_address(place):
        return json.dumps(RemoteFile(place).stamp())
    status = os.stat(place)
    return json.dumps([status.st_size, status.st_mtime_ns, status.st_ino])


def _missing(error: ImportError) -> MissingExtraError:
    return MissingExtraError(f"this needs the package {error.name}; run: pip install 'pdecodec[dask]'")
