"""What an Alembic archive holds, and what becomes of it, by the format's own words.

Every object, property and time sampling is listed. What no reader of ours has taken is dropped, and named once.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple

from alembic3d import Abc, AbcGeom

from pdecodec.formats.alembic.attributes import FPS_PROPERTY, METADATA_PROPERTY
from pdecodec.formats.alembic.shapes import MOST_LEVELS, AlembicShape, hides
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
"""Properties of schemas that are always kept where the object is, with what else the reader of a shape has taken."""

_IMPLIED = {".selfBnds", ".childBnds", ".animChans", ".facesExclusive", ".pointIds"}
"""Properties that follow from others, or that say no more where the reader of a shape has not taken them."""

_LOST = {
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
"""Words for properties of schemas that are not kept."""

_KINDS = (
    (AbcGeom.ICamera, "cameras"),
    (AbcGeom.ILight, "lights"),
    (AbcGeom.INuPatch, "NURBS surfaces"),
    (AbcGeom.IXform, "transforms without shapes"),
    (AbcGeom.IPolyMesh, "meshes without vertices"),
    (AbcGeom.ISubD, "subdivision surfaces without vertices"),
    (AbcGeom.ICurves, "curves without points"),
    (AbcGeom.IPoints, "points without positions"),
)
"""Words for objects that are not kept, by their schema."""


def take_inventory(
    archive: Any, shapes: Sequence[AlembicShape], samplings: Sequence[Any], said: Collection[str]
) -> tuple[tuple[Content, ...], tuple[str, ...]]:
    """List everything that an archive holds, and give words for what of it is not kept and nobody has named.

    Parameters
    ----------
    archive : IArchive
    shapes : sequence of AlembicShape
        What the reader has taken.
    samplings : sequence of TimeSampling
        Those at which what moves is kept.
    said : collection of str
        Names of objects that are left out in words of their own.
    """
    walk = _Walk(shapes, said)
    walk.archive(archive, samplings)
    return tuple(walk.contents), tuple(walk.words())


class _Owner(NamedTuple):
    """An object as its properties see it: its path, its kind by :data:`_KEPT`, and the shape that was read of it."""

    path: str
    kind: str
    shape: AlembicShape | None
    is_kept: bool
    node: Any = None


class _Walk:
    def __init__(self, shapes: Sequence[AlembicShape], said: Collection[str]) -> None:
        self.contents: list[Content] = []
        self._lost: dict[str, dict[str, None]] = {}
        self._shapes = {shape.node.getFullName(): shape for shape in shapes}
        self._said = set(said)
        self._above = {path[:end] for path in self._shapes for end in range(len(path)) if path[end] == "/"}

    def archive(self, archive: Any, samplings: Sequence[Any]) -> None:
        """List what belongs to no object, then all objects."""
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

    def words(self) -> Iterator[str]:
        """Give what is not kept, kind after kind."""
        for word, names in self._lost.items():
            if not names:
                yield word
            elif word.endswith(":"):
                yield f"{word.removesuffix(':')} ({', '.join(names)})"
            else:
                yield f"{word} {listed(list(names))}"

    def _note(self, path: str, kind: str, fate: Fate, word: str = "", name: str = "") -> None:
        """List something; where it is dropped, with the word for its kind, which ends in a colon for properties."""
        self.contents.append(Content(path, kind, fate))
        if fate == "dropped" and word:
            self._lose(word, name)

    def _lose(self, word: str, name: str = "") -> None:
        self._lost.setdefault(word, {}).update({name: None} if name else {})

    def _objects(self, node: Any, above: str, levels: int) -> None:
        for index in range(node.getNumChildren() if levels <= MOST_LEVELS else 0):
            header = node.getChildHeader(index)
            path, schema = f"{above}/{header.getName()}", header.getMetaData().get("schema")
            try:
                child = node.getChild(index)
                schema = child.getMetaData().get("schema")
                self._properties(child.getProperties(), self._object(child, path, above, schema))
                self._objects(child, path, levels + 1)
            except RuntimeError:
                # What the library cannot open is refused, or left out in words of its own.
                self.contents.append(Content(path, schema or "object", "dropped"))

    def _object(self, node: Any, path: str, above: str, schema: str) -> _Owner:
        shape, parent, header = self._shapes.get(path), self._shapes.get(above), node.getHeader()
        name = path.rpartition("/")[2]
        if AbcGeom.IFaceSet.matches(header):
            is_kept = parent is not None and parent.fates.get(name, (True, ""))[0]
            self.contents.append(Content(path, schema, "coded" if is_kept else "dropped"))
            return _Owner(path, "face set", None, is_kept)
        is_kept = shape is not None or path in self._above
        word = next((word for kind, word in _KINDS if kind.matches(header)), "")
        word = word or (f"objects of schema {schema}" if schema else "objects without a schema")
        said = any(path.endswith(one) for one in self._said)
        self._note(path, schema or "object", "coded" if is_kept else "dropped", "" if said else word, path[1:])
        kind = "transform" if AbcGeom.IXform.matches(header) else "object"
        return _Owner(path, kind if shape is None else shape.kind, shape, is_kept, node)

    def _properties(self, parent: Any, owner: _Owner, above: tuple[str, ...] = (), fate: Fate | None = None) -> None:
        """List the properties of a compound below others, all of one fate where it is given."""
        for index in range(parent.getNumProperties()):
            header = parent.getPropertyHeader(index)
            steps = (*above, header.getName())
            # The schema of the object goes without saying.
            below = "/".join(steps[1:] if len(steps) > 1 and above[0] in _SCHEMAS else steps)
            own = fate or self._fate(parent, header, steps, below, owner)
            self.contents.append(Content(f"{owner.path}:/{'/'.join(steps)}", below, own))
            if header.isCompound():
                inner = Abc.ICompoundProperty(parent, header.getName())
                self._properties(inner, owner, steps, None if own == "implied" else own)

    def _fate(self, parent: Any, header: Any, steps: tuple[str, ...], below: str, owner: _Owner) -> Fate:
        """Return what becomes of a property, and note words for it where it is dropped."""
        if not owner.is_kept:
            return "dropped"
        name, is_schema = steps[-1], len(steps) == 2 and steps[0] in _SCHEMAS
        taken = owner.shape.fates.get(below) if owner.shape is not None and steps[0] in _SCHEMAS else None
        if taken is not None:
            # The reader has its own words for what it does not keep.
            return "coded" if taken[0] else "dropped"
        if header.isCompound() and header.getMetaData().get("isGeomParam") != "true":
            # Its properties are told one by one.
            return "implied"
        if steps == ("visible",) and owner.node is not None:
            # Shapes that are hidden are named as such.
            return "dropped" if hides(owner.node) else "coded"
        if name in _KEPT[owner.kind] and (is_schema or not owner.path):
            return "coded"
        implied = (is_schema or not owner.path) and (name in _IMPLIED or name.endswith(".samples"))
        if implied or _says_nothing(parent, header, is_option=is_schema):
            return "implied"
        of = " of transforms" if owner.kind == "transform" else ""
        if len(steps) > 2:
            self._lose(f"{steps[1].lstrip('.')}{of}:", name)
        elif is_schema:
            self._lose(*((_LOST[name],) if name in _LOST else (f"properties of {owner.kind}:", name)))
        else:
            self._lose("properties of objects:" if owner.path else "archive properties:", name)
        return "dropped"


def _says_nothing(parent: Any, header: Any, *, is_option: bool) -> bool:
    """Whether a property has no sample or none but an empty array; an option of a schema also where it is 0."""
    reader = Abc.IScalarProperty if header.isScalar() else Abc.IArrayProperty
    try:
        prop = reader(parent, header.getName())
        if not prop.getNumSamples():
            return True
        if header.isScalar():
            return bool(is_option and prop.isConstant() and prop.getValue() == 0)
        return bool(prop.isConstant() and not len(prop.getValue()))
    except (RuntimeError, TypeError):
        # Numbers that the Python binding has no type for, and compounds.
        return False
