"""Write XDMF: one topology, a dataset of positions per frame, and a small XML file that names them."""

from __future__ import annotations

from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from pdecodec.formats.arrays.hdf5 import new_hdf5
from pdecodec.formats.base.attribute_roles import lost_by_joining
from pdecodec.formats.base.normals import VertexNormals
from pdecodec.formats.base.registry import Output
from pdecodec.formats.vtk.xdmf_cells import MIXED_KINDS
from pdecodec.mesh.arrays import Int32Array
from pdecodec.mesh.sequence import Connectivity, MeshSequence
from pdecodec.system.whole_output import check_writable, partial_folder, publish, write_errors


def write_xdmf(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write ``name.xdmf`` with ``name.h5`` next to it; objects are joined to one grid."""
    path = output.path
    data_path = path.with_suffix(".h5")
    for one in (path, data_path):
        check_writable(one, overwrite=output.overwrite)
    with partial_folder(path) as folder, write_errors(path):
        with new_hdf5(folder / data_path.name) as (file, check):
            topology = _write_topology(file, sequence.connectivity, data_path.name)
            rows, normals = [], VertexNormals(sequence)
            for start, block in output.blocks(sequence, "XDMF"):
                for frame, points in enumerate(block, start):
                    name = f"points/{frame:06d}"
                    check()
                    file.create_dataset(name, data=np.ascontiguousarray(points, "<f4"), track_times=False)
                    shading = f"normals/{frame:06d}" if normals.held else None
                    if shading is not None:
                        file.create_dataset(shading, data=normals.at(points).astype("<f4"), track_times=False)
                    time = float(sequence.times[frame])
                    rows.append(_grid_text(topology, name, shading, data_path.name, len(points), time))
        (folder / path.name).write_text(_HEAD + "".join(rows) + _TAIL, encoding="utf-8")
        publish(folder, [data_path.name, path.name], overwrite=output.overwrite)
    return lost_by_joining(sequence, "XDMF", "grid", held=normals.holds)


_HEAD = (
    '<?xml version="1.0"?>\n<Xdmf Version="3.0">\n  <Domain>\n'
    '    <Grid Name="sequence" GridType="Collection" CollectionType="Temporal">\n'
)
_TAIL = "    </Grid>\n  </Domain>\n</Xdmf>\n"


def _write_topology(file: Any, whole: Connectivity, data_name: str) -> str:
    """Write the topology's dataset and return its XML: faces of one kind directly, anything else as mixed."""
    sizes = set(whole.face_counts.tolist())
    if not whole.face_count and not whole.line_count:
        return f'        <Topology TopologyType="Polyvertex" NumberOfElements="{whole.vertex_count}"/>\n'
    if not whole.line_count and len(sizes) == 1 and sizes <= {3, 4}:
        kind = "Triangle" if sizes == {3} else "Quadrilateral"
        numbers, count = whole.face_indices.reshape(whole.face_count, -1), whole.face_count
    else:
        kind, count = "Mixed", whole.face_count + whole.line_count
        cells: list[Int32Array] = []
        for counts, indices, line in (
            (whole.face_counts, whole.face_indices, False),
            (whole.line_counts, whole.line_indices, True),
        ):
            ends = np.cumsum(counts, dtype=np.int64)
            for size, end in zip(counts.tolist(), ends.tolist(), strict=True):
                number = (1 if size == 1 else 2) if line else {3: 4, 4: 5}.get(size, 3)
                head = [number] if number in MIXED_KINDS else [number, size]
                cells += [np.array(head, np.int32), indices[end - size : end]]
        numbers = np.concatenate(cells)
    file.create_dataset("topology", data=np.ascontiguousarray(numbers, "<i4"), track_times=False)
    shape = " ".join(map(str, numbers.shape))
    return (
        f'        <Topology TopologyType="{kind}" NumberOfElements="{count}">\n'
        f'          <DataItem Dimensions="{shape}" NumberType="Int" Precision="4" Format="HDF">'
        f"{escape(data_name)}:/topology</DataItem>\n        </Topology>\n"
    )


def _grid_text(topology: str, name: str, normals: str | None, data_name: str, points: int, time: float) -> str:
    def vectors(dataset: str) -> str:
        return (
            f'          <DataItem Dimensions="{points} 3" NumberType="Float" Precision="4" Format="HDF">'
            f"{escape(data_name)}:/{dataset}</DataItem>\n"
        )

    shading = ""
    if normals is not None:
        head = '        <Attribute Name="Normals" AttributeType="Vector" Center="Node">\n'
        shading = f"{head}{vectors(normals)}        </Attribute>\n"
    return (
        f'      <Grid Name="mesh" GridType="Uniform">\n        <Time Value="{time!r}"/>\n{topology}'
        f'        <Geometry GeometryType="XYZ">\n{vectors(name)}        </Geometry>\n{shading}      </Grid>\n'
    )
