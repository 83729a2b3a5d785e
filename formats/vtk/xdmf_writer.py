"""Write XDMF: one topology, datasets of positions and fields per frame, and a small XML file that names them."""

from __future__ import annotations

from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.arrays.hdf5 import new_hdf5
from pdecodec.formats.base.attribute_roles import joining_notices
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.normals import VertexNormals
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.written_fields import WrittenFields
from pdecodec.formats.vtk.cells import only_known_cells
from pdecodec.formats.vtk.xdmf_cells import MIXED_KINDS
from pdecodec.mesh.sequence import CELL_SHAPES, Connectivity, MeshSequence
from pdecodec.system.whole_output import check_writable, partial_folder, publish, write_errors


def write_xdmf(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write ``name.xdmf`` with ``name.h5`` next to it; objects are joined to one grid, fields are its attributes."""
    path = output.path
    data_path = path.with_suffix(".h5")
    for place in (path, data_path):
        check_writable(place, overwrite=output.overwrite)
    normals, fields = VertexNormals(sequence), WrittenFields(sequence, ("vertex", "face", "object", "cell"))
    is_replaced = _NORMALS in fields.names("vertex")
    has_normals = normals.held and not is_replaced
    known = [kind for kind in MIXED_KINDS.values() if kind[0] != "line"]
    whole, corners_alone = only_known_cells(fields.cells, "XDMF", [*known, ("line", 1), ("line", 2), ("line", 3)])
    with partial_folder(path) as folder, write_errors(path):
        with new_hdf5(folder / data_path.name) as (file, check):
            topology = _write_topology(file, whole, data_path.name)

            def stored(name: str, values: NDArray[Any]) -> str:
                check()
                data = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
                file.create_dataset(name, data=data, track_times=False)
                return _item_text(data_path.name, name, data)

            rows = []
            for start, block in output.blocks(sequence, "XDMF"):
                for frame, points in enumerate(block, start):
                    text = f'{topology}        <Geometry GeometryType="XYZ">\n'
                    text += f"{stored(f'points/{frame:06d}', points.astype(np.float32))}        </Geometry>\n"
                    if has_normals:
                        shading = stored(f"normals/{frame:06d}", normals.at(points).astype(np.float32))
                        text += _attribute_text(_NORMALS, 3, "Node", shading)
                    for number, (one, values) in enumerate(fields.at(frame)):
                        item = stored(f"fields/{number}/{frame:06d}", values)
                        text += _attribute_text(one.name, one.field.components, _CENTERS[one.field.domain], item)
                    rows.append(_grid_text(text, float(sequence.times[frame])))
        (folder / path.name).write_text(_HEAD + "".join(rows) + _TAIL, encoding="utf-8")
        publish(folder, [data_path.name, path.name], overwrite=output.overwrite)
    return (
        *joining_notices(sequence, "XDMF", "grid", held=normals.holds),
        *not_kept([_NORMALS] * (normals.held and is_replaced), "not kept, because fields have their names: {}"),
        *fields.notices(),
        *corners_alone,
    )


_NORMALS = "Normals"
"""Name of the attribute of normals."""

_CENTERS = {"vertex": "Node", "face": "Cell", "cell": "Cell", "object": "Grid"}

_TYPES = {1: "Scalar", 9: "Tensor"}
"""Types of attributes by the number of components; others are vectors: VTK changes the order of a Tensor6."""

_HEAD = (
    '<?xml version="1.0"?>\n<Xdmf Version="3.0">\n  <Domain>\n'
    '    <Grid Name="sequence" GridType="Collection" CollectionType="Temporal">\n'
)
_TAIL = "    </Grid>\n  </Domain>\n</Xdmf>\n"


def _write_topology(file: Any, whole: Connectivity, data_name: str) -> str:
    """Write the topology's dataset and return its XML: cells of one kind directly, anything else as mixed."""
    if not whole.cell_count:
        return f'        <Topology TopologyType="Polyvertex" NumberOfElements="{whole.vertex_count}"/>\n'
    heads: dict[tuple[int, int], tuple[int, ...]] = {}
    keys = list(zip(whole.cell_shapes.tolist(), whole.cell_counts.tolist(), strict=True))
    for key in dict.fromkeys(keys):
        kind = CELL_SHAPES[key[0]], key[1]
        counted = 3 if kind[0] == "polygon" else 1 if key[1] == 1 else 2, key[1]
        heads[key] = next(((number,) for number, known in MIXED_KINDS.items() if known == kind), counted)
    name = _TOPOLOGIES.get(heads[keys[0]][0], "Mixed") if len(heads) == 1 else "Mixed"
    if name != "Mixed":
        numbers = whole.cell_indices.reshape(len(keys), -1)
    else:
        cells = np.split(whole.cell_indices, np.cumsum(whole.cell_counts, dtype=np.int64)[:-1])
        parts = ((heads[key], nodes) for key, nodes in zip(keys, cells, strict=True))
        numbers = np.concatenate([np.asarray(part, np.int32) for both in parts for part in both])
    data = np.ascontiguousarray(numbers, "<i4")
    file.create_dataset("topology", data=data, track_times=False)
    return (
        f'        <Topology TopologyType="{name}" NumberOfElements="{len(keys)}">\n'
        f"{_item_text(data_name, 'topology', data)}        </Topology>\n"
    )


_TOPOLOGIES = {
    **{4: "Triangle", 5: "Quadrilateral", 6: "Tetrahedron", 7: "Pyramid", 8: "Wedge", 9: "Hexahedron"},
    **{35: "Quadrilateral_9", 36: "Triangle_6", 37: "Quadrilateral_8", 38: "Tetrahedron_10", 39: "Pyramid_13"},
    **{40: "Wedge_15", 41: "Wedge_18", 48: "Hexahedron_20", 49: "Hexahedron_24", 50: "Hexahedron_27"},
}
"""Topologies of one kind of cells, by its number in mixed topologies."""


def _item_text(data_name: str, place: str, data: NDArray[Any]) -> str:
    """Return the DataItem of a dataset."""
    kind, size = {"f": "Float", "i": "Int", "u": "UInt"}[data.dtype.kind], data.dtype.itemsize
    if size == 1:
        kind = {"Int": "Char", "UInt": "UChar"}[kind]
    return (
        f'          <DataItem Dimensions="{" ".join(map(str, data.shape))}" NumberType="{kind}" Precision="{size}" '
        f'Format="HDF">{escape(data_name)}:/{place}</DataItem>\n'
    )


def _attribute_text(name: str, components: int, center: str, item: str) -> str:
    kind = _TYPES.get(components, "Vector")
    head = f'        <Attribute Name={quoteattr(name)} AttributeType="{kind}" Center="{center}">\n'
    return f"{head}{item}        </Attribute>\n"


def _grid_text(content: str, time: float) -> str:
    return f'      <Grid Name="mesh" GridType="Uniform">\n        <Time Value="{time!r}"/>\n{content}      </Grid>\n'
