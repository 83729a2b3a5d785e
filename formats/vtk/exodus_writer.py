"""Write Exodus II: nodes with their displacements in every step, blocks of elements, and variables for fields.

Nodes have the positions of the first frame as coordinates, and move by the nodal variables ``displ_x``, ``displ_y``,
``displ_z``, as the programs of Exodus expect. These are float64, so that adding them gives the float32 positions again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec import __version__
from pdecodec.formats.base.attribute_roles import GROUP, left_out
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.written_fields import WrittenField, WrittenFields
from pdecodec.formats.vtk.cells import BLOCK, NODE
from pdecodec.formats.vtk.exodus import PROGRAM
from pdecodec.formats.vtk.exodus_blocks import Block, cell_blocks, element_blocks, fitting
from pdecodec.formats.vtk.exodus_variables import AXES, component_names, displacements, vectors_of
from pdecodec.formats.vtk.netcdf_file import NetcdfWriter, new_netcdf
from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence

_NAME_BYTES, _STRING_BYTES, _LINE_BYTES = 32, 32, 80
"""Lengths of names, strings and lines that Exodus' programs expect at least [bytes]."""

_END_BYTES = 8
"""Room for a number and a component at the end of a name [bytes]."""

_DISPLACEMENTS = tuple(f"displ_{axis}" for axis in AXES)

_INFO = ("Nodes move by displ_x, displ_y, displ_z from their coordinates,", "which are those of the first step.")


def write_exodus(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write one netCDF-4 file; objects and groups of faces become blocks of elements, fields become variables."""
    fields = WrittenFields(sequence, ("vertex", "face", "cell"))
    if fields.has_cells:
        (blocks, notices), is_group_kept = cell_blocks(sequence, fields.cells), True
    else:
        blocks, notices, is_group_kept = element_blocks(sequence)
    nodal = _Variables([one for one in fields.fields if one.field.domain == "vertex"], _DISPLACEMENTS)
    elemental = _Variables([one for one in fields.fields if one.field.domain != "vertex" and blocks])
    numbers = _numbers_of_nodes(sequence)
    with output.whole_file() as partial, new_netcdf(partial) as file:
        first = sequence.read_frames(0, 1)[0].astype(np.float64)
        rest = np.where(np.isfinite(first), first, 0.0)  # displacements carry values that are not finite
        _write_header(file, sequence, [*nodal.names, *elemental.names, *(block.name for block in blocks)])
        _write_nodes(file, rest, numbers)
        _write_blocks(file, blocks)
        moving = [
            file.add_variable(f"vals_nod_var{axis + 1}", ("time_step", "num_nodes"), np.float64) for axis in range(3)
        ]
        nodal.write_names(file, "nod")
        stored = nodal.add(file, "vals_nod_var{}", "num_nodes")
        elemental.write_names(file, "elem")
        of_blocks = _add_element_variables(file, elemental, blocks)
        for _, _, start, points in output.blocks_of_runs(sequence, "Exodus", with_fields=True):
            steps = slice(start, start + len(points))
            for axis, variable in enumerate(moving):
                variable[steps] = points[..., axis] - rest[:, axis]
            for one in fields.fields:
                values = fields.read(one, steps.start, steps.stop)
                columns = np.moveaxis(values.reshape(len(points), -1, one.field.components), 2, 0)
                for component, column in enumerate(columns):
                    key = one.field.name, component
                    if one.field.domain == "vertex":
                        stored[key][steps] = column
                    for faces, variable in of_blocks.get(key, ()):
                        variable[steps] = column[:, faces]
            file.check()

    def is_held(item: MeshObject, attribute: Attribute) -> bool:
        if attribute.name == NODE:
            return numbers is not None
        if attribute.domain == "cell":
            return attribute.name == BLOCK
        return attribute.name == GROUP and attribute.domain == "face" and is_group_kept

    return (
        *notices,
        *nodal.notices,
        *left_out(sequence, "Exodus", is_held),
        *fields.notices(),
    )


def _write_header(file: NetcdfWriter, sequence: MeshSequence, names: Sequence[str]) -> None:
    """Write attributes, records, times and the dimensions that do not depend on blocks."""
    longest = max((len(name.encode()) for name in names), default=0)
    file.set_attributes({
        "api_version": np.float32(8.03), "version": np.float32(8.03), "floating_point_word_size": np.int32(8),
        "file_size": np.int32(1), "maximum_name_length": np.int32(max(_NAME_BYTES, longest)),
        "int64_status": np.int32(0), "title": np.bytes_(b"mesh sequence"),
    })  # fmt: skip
    file.add_dimension("time_step", sequence.frame_count, unlimited=True)
    for name, size in (
        ("len_string", _STRING_BYTES + 1), ("len_line", _LINE_BYTES + 1), ("four", 4),
        ("len_name", max(_NAME_BYTES, longest) + 1), ("num_dim", 3), ("num_nodes", sequence.vertex_count),
        ("num_qa_rec", 1), ("num_info", len(_INFO)),
    ):  # fmt: skip
        file.add_dimension(name, size)
    file.add_variable("time_whole", ("time_step",), np.float64, sequence.times)
    # A record has program, version, date and time. The last two stay empty, so that equal sequences give equal files.
    records = _characters([PROGRAM, __version__, "", ""], _STRING_BYTES + 1)[None]
    file.add_variable("qa_records", ("num_qa_rec", "four", "len_string"), "S1", records)
    file.add_variable("info_records", ("num_info", "len_line"), "S1", _characters(_INFO, _LINE_BYTES + 1))
    file.add_variable("coor_names", ("num_dim", "len_name"), "S1", _names(AXES, file))


def _numbers_of_nodes(sequence: MeshSequence) -> Int32Array | None:
    """Return the numbers that nodes had in the file they were read from; None if they are unknown, or equal for
    two nodes.
    """
    found = [one.values for one in sequence.objects[0].attributes if one.name == NODE and one.domain == "vertex"]
    if len(sequence.objects) > 1 or not found or found[0].min() < 1 or np.unique(found[0]).size < found[0].size:
        return None
    return found[0].astype(np.int32)


def _write_nodes(file: NetcdfWriter, rest: NDArray[np.float64], numbers: Int32Array | None) -> None:
    if numbers is not None:
        file.add_variable("node_num_map", ("num_nodes",), np.int32, numbers)
    for axis, letter in enumerate(AXES):
        file.add_variable(f"coord{letter}", ("num_nodes",), np.float64, rest[:, axis])


def _write_blocks(file: NetcdfWriter, blocks: Sequence[Block]) -> None:
    """Write the blocks of elements: their ids, names, types and nodes."""
    if not blocks:
        return
    file.add_dimension("num_elem", sum(block.counts.size for block in blocks))
    file.add_dimension("num_el_blk", len(blocks))
    numbers = np.arange(1, len(blocks) + 1, dtype=np.int32)
    file.add_variable("eb_status", ("num_el_blk",), np.int32, np.ones_like(numbers))
    file.add_variable("eb_prop1", ("num_el_blk",), np.int32, numbers, {"name": np.bytes_(b"ID")})
    file.add_variable("eb_names", ("num_el_blk", "len_name"), "S1", _names([block.name for block in blocks], file))
    for number, block in enumerate(blocks, 1):
        elements, width, kind = (
            f"num_el_in_blk{number}",
            f"num_nod_per_el{number}",
            {"elem_type": np.bytes_(block.kind.encode())},
        )
        file.add_dimension(elements, block.counts.size)
        if block.kind == "NSIDED":  # the number of nodes of all its polygons together
            file.add_dimension(width, block.nodes.size)
            file.add_variable(f"connect{number}", (width,), np.int32, block.nodes + 1, kind)
            entries = {"entity_type1": np.bytes_(b"NODE"), "entity_type2": np.bytes_(b"ELEM")}
            file.add_variable(f"ebepecnt{number}", (elements,), np.int32, block.counts, entries)
        else:
            rows = block.nodes.reshape(block.counts.size, -1)
            file.add_dimension(width, rows.shape[1])
            file.add_variable(f"connect{number}", (elements, width), np.int32, rows + 1, kind)


class _Variables:
    """The variables for the components of fields, numbered after the existing ones.

    Attributes
    ----------
    names : list of str
        Of all variables.
    notices : tuple of str
        About names that had to change.
    """

    def __init__(self, fields: Sequence[WrittenField], before: Sequence[str] = ()) -> None:
        self.fields = fields
        self._before = len(before)
        parts = [component_names(one.name, one.field.components) for one in fields]
        moving = (
            displacements(vectors := vectors_of([name for names in parts for name in names], 3), 3) if before else []
        )
        numbers = {number for base in moving for number in vectors[base].values()}
        taken, first, changed = set(before), 1, []
        self.names = list(before)
        for one, names in zip(fields, parts, strict=True):
            own = one.name
            # Programs would move the mesh by a second displacement.
            if numbers & set(range(first, first + len(names))):
                own = f"field_{own}"
            first += len(names)
            # All components change their names together, so that readers still join them to one field.
            base = own = fitting(own, room=_END_BYTES)
            number, key = 1, str.lower if len(names) > 1 else str
            while {*map(key, taken)} & {*map(key, found := component_names(own, len(names)))}:
                number += 1
                own = f"{base} {number}"
            taken.update(found)
            if found != names:
                changed.append(f"{one.name!r} as {own if own != one.name else found[0]!r}")
            self.names += found
        self.notices = (f"names of fields that had to change: {', '.join(changed)}",) if changed else ()

    def write_names(self, file: NetcdfWriter, kind: str) -> None:
        if self.names:
            file.add_dimension(f"num_{kind}_var", len(self.names))
            file.add_variable(f"name_{kind}_var", (f"num_{kind}_var", "len_name"), "S1", _names(self.names, file))

    def add(
        self, file: NetcdfWriter, array: str, dimension: str, owner: int | None = None
    ) -> dict[tuple[str, int], Any]:
        """Return new arrays for the variables of fields, by field and component. If `owner` is given, only for
        fields of that object.
        """
        found, number = {}, self._before
        for one in self.fields:
            has_it = owner is None or one.field.objects is None or owner in one.field.objects
            for component in range(one.field.components):
                number += 1
                if has_it:
                    variable = file.add_variable(array.format(number), ("time_step", dimension), one.dtype)
                    found[one.field.name, component] = variable
        return found


def _add_element_variables(
    file: NetcdfWriter, variables: _Variables, blocks: Sequence[Block]
) -> dict[tuple[str, int], list[tuple[slice | Int64Array, Any]]]:
    """Return new arrays by field and component, each with its faces, and write which blocks have which variables."""
    found: dict[tuple[str, int], list[tuple[slice | Int64Array, Any]]] = {}
    if not variables.names:
        return found
    keys = [(one.field.name, component) for one in variables.fields for component in range(one.field.components)]
    table = np.zeros((len(blocks), len(keys)), np.int32)
    for number, block in enumerate(blocks, 1):
        if block.faces is None:
            continue
        own = variables.add(file, f"vals_elem_var{{}}eb{number}", f"num_el_in_blk{number}", block.owner)
        table[number - 1] = [key in own for key in keys]
        for key, variable in own.items():
            found.setdefault(key, []).append((block.faces, variable))
    file.add_variable("elem_var_tab", ("num_el_blk", "num_elem_var"), np.int32, table)
    return found


def _names(names: Sequence[str], file: NetcdfWriter) -> NDArray[np.bytes_]:
    return _characters(names, file.size("len_name"))


def _characters(texts: Sequence[str], width: int) -> NDArray[np.bytes_]:
    """Return texts as rows of single bytes (texts, width), filled with zeros."""
    rows = b"".join(text.encode()[:width].ljust(width, b"\0") for text in texts)
    return np.frombuffer(rows, "S1").reshape(len(texts), width)
