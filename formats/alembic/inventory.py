"""List everything in an Alembic archive, and whether it is kept, by the names that Alembic uses.

Every object, property and time sampling is listed. Anything that the readers did not use is dropped, and a note
names each kind of it once.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple

from alembic3d import Abc, AbcGeom

from pdecodec.formats.alembic.attributes import FPS_PROPERTY, METADATA_PROPERTY
from pdecodec.formats.alembic.shapes import MAX_LEVELS, AlembicShape, is_ever_hidden
from pdecodec.formats.base.scene_reading import listed
from pdecodec.mesh.sequence import Content, Fate

_SCHEMAS = (".geom", ".xform", ".faceset")
"""Compound properties that hold the schema of an object."""

_KEPT = {
    "mesh": {"P", ".faceIndices", ".faceCounts"},
    "subdivision": {"P", ".faceIndices", ".faceCounts", ".scheme"},
    "curves": {"P", "nVertices", "curveBasisAndType"},
    "points": {"P"},
    "transform": {".inherits", ".ops", ".vals", "isNotConstantIdentity"},
    "face set": {".faces"},
    "archive": {FPS_PROPERTY, METADATA_PROPERTY},
    "object": set(),
}
"""Properties of schemas that are kept if their object is, in addition to those that the shape's reader used."""

_IMPLIED = {".selfBnds", ".childBnds", ".animChans", ".facesExclusive", ".pointIds"}
"""Properties that follow from others, or that hold no further information unless the shape's reader used them."""

_LOST_PROPERTIES = {
    ".velocities": "velocities",
    "width": "widths",
    ".widths": "widths",
    ".orders": "knots and orders of curves",
    ".knots": "knots and orders of curves",
    "w": "weights of positions",
    "N": "normals",
    "uv": "uv",
    ".holes": "holes",
    **dict.fromkeys((".creaseIndices", ".creaseLengths", ".creaseSharpnesses"), "creases and corners"),
    **dict.fromkeys((".cornerIndices", ".cornerSharpnesses"), "creases and corners"),
}
"""Words in notes for properties of schemas that are not kept."""

_LOST_OBJECTS = (
    (AbcGeom.ICamera, "cameras"),
    (AbcGeom.ILight, "lights"),
    (AbcGeom.INuPatch, "NURBS surfaces"),
    (AbcGeom.IXform, "transforms without shapes"),
    (AbcGeom.IPolyMesh, "meshes without vertices"),
    (AbcGeom.ISubD, "subdivision surfaces without vertices"),
    (AbcGeom.ICurves, "curves without points"),
    (AbcGeom.IPoints, "points without positions"),
)
"""Words in notes for objects that are not kept, by their schema."""


def take_inventory(
    archive: Any, shapes: Sequence[AlembicShape], samplings: Sequence[Any], named_elsewhere: Collection[str]
) -> tuple[tuple[Content, ...], tuple[str, ...]]:
    """List everything in an archive; return the list, and notes on losses that no other note names.

    Parameters
    ----------
    archive : IArchive
    shapes : sequence of AlembicShape
        The shapes that are read.
    samplings : sequence of TimeSampling
        Time samplings of the positions and transforms that are read.
    named_elsewhere : collection of str
        Names of objects that other notes already name.
    """
    walk = _Walk(shapes, named_elsewhere)
    walk.archive(archive, samplings)
    return tuple(walk.contents), tuple(walk.notices())


class _Owner(NamedTuple):
    """The object that properties belong to: its path, its kind in :data:`_KEPT`, and the shape that was read
    from it.
    """

    path: str
    kind: str
    shape: AlembicShape | None
    is_kept: bool
    node: Any = None


class _Walk:
    def __init__(self, shapes: Sequence[AlembicShape], named_elsewhere: Collection[str]) -> None:
        self.contents: list[Content] = []
        self._lost: dict[str, dict[str, None]] = {}
        self._shapes = {shape.node.getFullName(): shape for shape in shapes}
        self._named_elsewhere = set(named_elsewhere)
        self._above = {path[:end] for path in self._shapes for end in range(len(path)) if path[end] == "/"}

    def archive(self, archive: Any, samplings: Sequence[Any]) -> None:
        """List the properties of the archive itself, then all objects."""
        facts = Abc.GetArchiveInfo(archive)
        fates: dict[str, Fate] = {"appName": "coded", "userDescription": "dropped"}
        for name in ("appName", "userDescription", "whenWritten", "libraryVersionString"):
            if facts.get(name):
                fate: Fate = fates.get(name, "implied")
                self._note(f"archive {name}", name, fate, "archive properties:", name)
        for number in range(archive.getNumTimeSamplings()):
            sampling = archive.getTimeSampling(number)
            is_used = any(sampling == one for one in samplings)
            self._note(f"time sampling {number}", "time sampling", "coded" if is_used else "implied")
        top = archive.getTop()
        self._properties(top.getProperties(), _Owner("", "archive", None, True))
        self._objects(top, "", 0)

    def notices(self) -> Iterator[str]:
        """Yield the notes on losses, one per kind."""
        for word, names in self._lost.items():
            if not names:
                yield word
            elif word.endswith(":"):
                yield f"{word.removesuffix(':')} ({', '.join(names)})"
            else:
                yield f"{word} {listed(list(names))}"

    def _note(self, path: str, kind: str, fate: Fate, word: str = "", name: str = "") -> None:
        """List an item. If it is dropped, note it under `word`, which ends in a colon for properties."""
        self.contents.append(Content(path, kind, fate))
        if fate == "dropped" and word:
            self._note_loss(word, name)

    def _note_loss(self, word: str, name: str = "") -> None:
        self._lost.setdefault(word, {}).update({name: None} if name else {})

    def _objects(self, node: Any, above: str, levels: int) -> None:
        for index in range(node.getNumChildren() if levels <= MAX_LEVELS else 0):
            header = node.getChildHeader(index)
            path, schema = f"{above}/{header.getName()}", header.getMetaData().get("schema")
            try:
                child = node.getChild(index)
                schema = child.getMetaData().get("schema")
                self._properties(child.getProperties(), self._object(child, path, above, schema))
                self._objects(child, path, levels + 1)
            except RuntimeError:
                # Objects that the library cannot open are refused or left out, with a note of their own.
                self.contents.append(Content(path, schema or "object", "dropped"))

    def _object(self, node: Any, path: str, above: str, schema: str) -> _Owner:
        shape, parent, header = self._shapes.get(path), self._shapes.get(above), node.getHeader()
        name = path.rpartition("/")[2]
        if AbcGeom.IFaceSet.matches(header):
            is_kept = parent is not None and parent.fates.get(name, (True, ""))[0]
            self.contents.append(Content(path, schema, "coded" if is_kept else "dropped"))
            return _Owner(path, "face set", None, is_kept)
        is_kept = shape is not None or path in self._above
        word = next((word for kind, word in _LOST_OBJECTS if kind.matches(header)), "")
        word = word or (f"objects of schema {schema}" if schema else "objects without a schema")
        named_elsewhere = any(path.endswith(one) for one in self._named_elsewhere)
        self._note(
            path, schema or "object", "coded" if is_kept else "dropped", "" if named_elsewhere else word, path[1:]
        )
        kind = "transform" if AbcGeom.IXform.matches(header) else "object"
        return _Owner(path, kind if shape is None else shape.kind, shape, is_kept, node)

    def _properties(self, parent: Any, owner: _Owner, above: tuple[str, ...] = (), fate: Fate | None = None) -> None:
        """List the properties of a compound, recursively, all with one fate if it is given."""
        for index in range(parent.getNumProperties()):
            header = parent.getPropertyHeader(index)
            steps = (*above, header.getName())
            # The path leaves out the schema of the object.
            below = "/".join(steps[1:] if len(steps) > 1 and above[0] in _SCHEMAS else steps)
            own = fate or self._fate(parent, header, steps, below, owner)
            self.contents.append(Content(f"{owner.path}:/{'/'.join(steps)}", below, own))
            if header.isCompound():
                inner = Abc.ICompoundProperty(parent, header.getName())
                self._properties(inner, owner, steps, None if own == "implied" else own)

    def _fate(self, parent: Any, header: Any, steps: tuple[str, ...], below: str, owner: _Owner) -> Fate:
        """Return what becomes of a property, and note it if it is dropped."""
        if not owner.is_kept:
            return "dropped"
        name, is_schema = steps[-1], len(steps) == 2 and steps[0] in _SCHEMAS
        taken = owner.shape.fates.get(below) if owner.shape is not None and steps[0] in _SCHEMAS else None
        if taken is not None:
            # The reader writes its own notes on losses.
            return "coded" if taken[0] else "dropped"
        if header.isCompound() and header.getMetaData().get("isGeomParam") != "true":
            # Its properties are listed one by one.
            return "implied"
        if steps == ("visible",) and owner.node is not None:
            # Another note names hidden shapes.
            return "dropped" if is_ever_hidden(owner.node) else "coded"
        if name in _KEPT[owner.kind] and (is_schema or not owner.path):
            return "coded"
        implied = (is_schema or not owner.path) and (name in _IMPLIED or name.endswith(".samples"))
        if implied or _is_empty(parent, header, is_option=is_schema):
            return "implied"
        of = " of transforms" if owner.kind == "transform" else ""
        if len(steps) > 2:
            self._note_loss(f"{steps[1].lstrip('.')}{of}:", name)
        elif is_schema:
            self._note_loss(
                *((_LOST_PROPERTIES[name],) if name in _LOST_PROPERTIES else (f"properties of {owner.kind}:", name))
            )
        else:
            self._note_loss("properties of objects:" if owner.path else "archive properties:", name)
        return "dropped"


def _is_empty(parent: Any, header: Any, *, is_option: bool) -> bool:
    """Return whether a property has no sample or only an empty array; an option of a schema also if it is 0."""
    reader = Abc.IScalarProperty if header.isScalar() else Abc.IArrayProperty
    try:
        prop = reader(parent, header.getName())
        if not prop.getNumSamples():
            return True
        if header.isScalar():
            return bool(is_option and prop.isConstant() and prop.getValue() == 0)
        return bool(prop.isConstant() and not len(prop.getValue()))
    except (RuntimeError, TypeError):
        # Compounds, and numbers that the Python binding has no type for.
        return False
