"""Copy an Exodus file with another motion: all arrays stay except coordinates, displacements, times and fields."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.onto import Fitted
from pdecodec.formats.base.registry import Output
from pdecodec.formats.vtk.exodus import ExodusSequence
from pdecodec.formats.vtk.exodus_variables import AXES, StoredField
from pdecodec.formats.vtk.netcdf_variables import copy_values, is_stepped
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import MeshSequence

FLAT = 1e-6
"""Largest motion along an axis without displacements that is not reported, relative to the largest coordinate."""


def write_exodus_onto(
    sequence: MeshSequence, original: ExodusSequence, fits: Sequence[Fitted], source: Path, output: Output
) -> tuple[str, ...]:
    """Write a copy of the original whose nodes move as in a sequence.

    Variables that are not written anew have the values of the step before, or of the first.
    """
    try:
        return _write(sequence, original, source, output)
    except (LookupError, ValueError, TypeError, ArithmeticError, RuntimeError, AttributeError, MemoryError) as error:
        raise damaged(f"its arrays do not fit each other ({error}); export it again", path=source) from error


def _write(sequence: MeshSequence, original: ExodusSequence, source: Path, output: Output) -> tuple[str, ...]:
    steps = None
    if original.has_steps:
        steps = np.maximum(np.searchsorted(original.times, sequence.times, side="right") - 1, 0)
    elif sequence.frame_count > 1:
        raise InputError(
            f"{source.name} has no displacements, and so its nodes cannot move", code="unsupported-feature", path=source
        )
    fields = _fields_to_write(sequence, original) if output.is_filled else {}
    names = {id(original.variables[name]): name for name in original.variables}
    columns = {
        names[id(array)]: (name, part, component)
        for name, stored in fields.items()
        for part, arrays in stored.parts
        for component, array in enumerate(arrays)
    }
    with (
        output.whole_file() as partial,
        original.variables.file_like(partial, None if steps is None else len(steps)) as new,
    ):
        first = sequence.read_frames(0, 1)[0]
        if original.variables.is_cut:
            original.variables.check_memory(original.variables)
        rest = original.rest.copy()
        nodes: Any = slice(None) if original.gather is None else original.gather
        if not original.moving or has_no_rest(original):
            rest[nodes] = first
        written = _write_constant(original, new, rest, steps, {*columns, *original.moving.values()})
        for run, _, start, block in output.blocks_of_runs(sequence, "Exodus", with_fields=True):
            if steps is None:
                continue
            own = slice(start, start + len(block))
            new["time_whole"][own] = sequence.times[own]
            for axis, name in original.moving.items():
                moved = block[..., axis].astype(np.float64) - rest[nodes, axis]
                new[name][own] = _with_columns(original, name, steps[own], nodes, moved)
            values = {name: run.read_field(name, own.start, own.stop) for name in fields}
            for name, (field, part, component) in columns.items():
                chosen = values[field].reshape(len(block), -1, fields[field].field.components)[:, part.rows, component]
                new[name][own] = _with_columns(original, name, steps[own], part.columns, chosen)
    held = steps is not None and not np.array_equal(original.times[steps], sequence.times) and written
    lacking = [axis for axis in range(3) if original.moving and axis not in original.moving]
    off = np.abs(first[:, lacking] - rest[nodes][:, lacking]).max(initial=0)
    return (
        *((f"variables hold the values of the step before: {', '.join(written)}",) if held else ()),
        *(
            not_kept([f"motion along {', '.join(AXES[axis] for axis in lacking)}, which has no displacements"])
            if off > FLAT * np.abs(first).max(initial=0) and not output.is_filled
            else ()
        ),
    )


def has_no_rest(original: ExodusSequence) -> bool:
    """Return whether coordinates were removed from a file."""
    return original.variables.is_cut and not original.rest.any()


def _fields_to_write(sequence: MeshSequence, original: ExodusSequence) -> dict[str, StoredField]:
    """Return those fields of the original that a sequence has too."""
    ours = {one.name: one for one in sequence.fields}
    return {
        name: stored
        for name, stored in original.stored.items()
        if name in ours and (ours[name].domain, ours[name].components) == (stored.field.domain, stored.field.components)
    }


def _write_constant(
    original: ExodusSequence, new: Any, rest: NDArray[np.float64], steps: Int64Array | None, moving: set[str]
) -> list[str]:
    """Write all arrays except times and those in `moving`; return the names of arrays with values for each step."""
    held = []
    for name in original.variables:
        old = original.variables[name]
        if name.startswith("coord") and name.removeprefix("coord") in ("", *AXES):
            axes = range(original.axes) if name == "coord" else AXES.index(name[-1])
            new[name][:] = rest[:, axes].T
        elif steps is None or not is_stepped(name, old):
            if old.shape == new[name].shape:  # else it is the scale of steps
                copy_values(old, new[name])
        elif name not in {*moving, "time_whole"}:
            copy_values(old, new[name], steps)
            held.append(name)
    return held


def _with_columns(
    original: ExodusSequence, name: str, steps: Int64Array, columns: Any, values: NDArray[Any]
) -> NDArray[Any]:
    """Return rows of an array of the original with other values in some columns."""
    old = original.variables[name]
    if isinstance(columns, slice):
        return values
    rows: NDArray[Any] = np.asarray(old[int(steps.min()) : int(steps.max()) + 1])[steps - steps.min()]
    rows[:, columns] = values
    return rows
