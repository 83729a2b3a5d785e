"""List everything that a USD stage holds, and what happens to it. Properties that no reader here uses are dropped, with
a notice.

Stages are listed as they are composed: prims, their properties and metadata, variants that are not selected, and the
metadata of the stage.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from enum import Enum
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from pdecodec.formats.base.scene_reading import Refusals, listed, lost_textures
from pdecodec.formats.usd.metadata import ADDED, METADATA, NAME, OWN, SAMPLED, object_name
from pdecodec.formats.usd.shapes import UsdShape
from pdecodec.mesh.sequence import Content
from pdecodec.mesh.sequence import Fate as ContentFate


class Fate(Enum):
    """What happens to a thing that a file holds."""

    CODED = "coded"
    APPLIED = "applied to positions"
    COMPOSED = "composed by USD"
    COMPUTED = "computed anew"
    DEFAULT = "the same as when it is not stated"
    TOLD = "told apart"
    DROPPED = "dropped"


class Item(NamedTuple):
    """A thing that a stage holds.

    Attributes
    ----------
    path : str
        Path of the prim or the property; ``/`` is the stage.
    key : str
        Name of the metadata, or of the variant set; empty for prims and properties.
    fate : Fate
    word : str
        Its name in the note about dropped things.
    """

    path: str
    key: str
    fate: Fate
    word: str = ""


_IN_CONTENTS: dict[Fate, ContentFate] = {
    Fate.CODED: "coded",
    Fate.APPLIED: "coded",
    Fate.COMPOSED: "implied",
    Fate.COMPUTED: "implied",
    Fate.DEFAULT: "implied",
    Fate.TOLD: "dropped",
    Fate.DROPPED: "dropped",
}
"""The same fates as sequences of all formats name them."""

_EVERYWHERE = {
    "visibility": Fate.TOLD,
    "xformOpOrder": Fate.CODED,
    "extent": Fate.COMPUTED,
    "extentsHint": Fate.COMPUTED,
}
"""Properties that any prim can have."""

_MESH = "points velocities accelerations normals faceVertexCounts faceVertexIndices orientation subdivisionScheme"

_READ = {
    "Mesh": _MESH,
    "TetMesh": "points velocities accelerations normals surfaceFaceVertexIndices orientation",
    "BasisCurves": "points velocities accelerations curveVertexCounts type basis wrap",
    "Points": "points velocities accelerations ids",
    "GeomSubset": "elementType indices familyName",
    "PointInstancer": "prototypes protoIndices positions orientations orientationsf scales ids invisibleIds",
    **dict.fromkeys(("Sphere", "Cube", "Cone"), "radius size height axis"),
    **dict.fromkeys(("Cylinder", "Capsule", "Plane"), "radius height axis width length"),
    **dict.fromkeys(("Cylinder_1", "Capsule_1"), "radiusBottom radiusTop height axis"),
}
"""Properties that are read, by type of prim."""

_BY_SHAPE = {
    "creaseIndices": "creases",
    "creaseLengths": "creases",
    "creaseSharpnesses": "creases",
    "cornerIndices": "corners",
    "cornerSharpnesses": "corners",
    "holeIndices": "holes",
    "velocities": "velocities",
    "normals": "normals",
    "primvars:normals": "normals",
    "tetVertexIndices": "tetrahedra (their surface is kept)",
    "material:binding": "material",
}
"""Names by which shapes report properties that they do not keep."""

_STRUCTURE = ("", "Xform", "Scope", "SkelRoot")
"""Types of prims that only group other prims."""

_READ_SCHEMAS = ("SkelBindingAPI", "MaterialBindingAPI")
"""API schemas whose properties are read."""

BINDING = str(UsdShade.Tokens.materialBinding)
"""The relationship of a prim to its material, and the prefix of other such names."""

_COMPOSED = """specifier typeName active instanceable clips clipSets variantSelection variantSetNames references payload
inheritPaths specializes relocates apiSchemas primOrder propertyOrder"""

_PRIM_METADATA = {**dict.fromkeys(_COMPOSED.split(), Fate.COMPOSED), "inactiveIds": Fate.CODED}

_STAGE_METADATA = {
    **dict.fromkeys(("defaultPrim", "subLayers", "expressionVariables", "layerRelocates"), Fate.COMPOSED),
    **dict.fromkeys(("upAxis", "metersPerUnit", "startTimeCode", "endTimeCode"), Fate.CODED),
    **dict.fromkeys(("framesPerSecond", "timeCodesPerSecond"), Fate.CODED),
}

_OWN_DATA = {METADATA, SAMPLED, OWN, NAME, ADDED}
"""Keys of custom data that pdecodec's writer stores."""


class Inventory:
    """Everything that a stage holds.

    Parameters
    ----------
    stage : Usd.Stage
    shapes : sequence of UsdShape
        The shapes that were read.
    refusals : Refusals
        The shapes that were refused and left out.

    Attributes
    ----------
    items : list of Item
    others : Counter
        Number of dropped prims by type.
    """

    def __init__(self, stage: Any, shapes: Sequence[UsdShape], refusals: Refusals) -> None:
        self.items: list[Item] = []
        self.others: Counter[str] = Counter()
        self._types: dict[str, str] = {}
        self._left_out: dict[str, set[str]] = {}
        self._prims: dict[str, dict[str, None]] = {}
        self._names: dict[str, dict[str, None]] = {}
        self._known: dict[Any, str] = {}
        self._textures: dict[str, None] = {}
        self._refused = {one.name for one in refusals.found}
        self._applied, self._within, self._bound = set[str](), set[Any](), set[Any]()
        for shape in shapes:
            self._take(shape)
        prims = list(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)))
        names = [prim.GetAuthoredPropertyNames() for prim in prims]
        for prim, of_prim in zip(prims, names, strict=True):
            for name in of_prim:
                if _binds(name):
                    self._bound.update(prim.GetRelationship(name).GetForwardedTargets())
        for prim, of_prim in zip(prims, names, strict=True):
            self._look_at(prim, of_prim)
        metadata = stage.GetPseudoRoot().GetAllAuthoredMetadata()
        self._look_at_metadata("/", metadata, _STAGE_METADATA, "metadata of the stage")

    def lost_textures(self) -> tuple[str, ...]:
        """Return a one-line note that names textures; empty if there are none."""
        return lost_textures(len(self._textures), [*self._textures])

    def contents(self) -> tuple[Content, ...]:
        """Return all items: prims are listed by type, properties and metadata by name."""
        return tuple(
            Content(
                f"{item.path} {item.key}" if item.key else item.path,
                item.key or item.path.partition(".")[2] or self._types[item.path],
                _IN_CONTENTS[item.fate],
            )
            for item in self.items
        )

    def left_out(self) -> list[str]:
        """Return the names of other dropped things, except those that shapes name themselves."""
        prims = [f"{kind} {listed([*names])}" for kind, names in self._prims.items()]
        return prims + [f"{kind} ({', '.join(names)})" for kind, names in self._names.items()]

    def _take(self, shape: UsdShape) -> None:
        prims = [shape.prim, *(prim for one, k in shape.instances for prim in (one.prim, one.root(k)))]
        self._left_out.setdefault(str(shape.prim.GetPath()), set()).update(shape.left_out)
        if shape.skinning is not None:
            self._applied |= shape.skinning.paths
            prims += [prim for path in shape.skinning.paths if (prim := shape.prim.GetStage().GetPrimAtPath(path))]
        for prim in prims:
            while prim and prim.GetPath() not in self._within:
                self._within.add(prim.GetPath())
                prim = prim.GetParent()

    def _drop(self, path: str, key: str, kind: str, name: str, *, is_prim: bool = False) -> None:
        """Note a thing that is dropped, under the word for its kind."""
        (self._prims if is_prim else self._names).setdefault(kind, {})[name] = None
        self.items.append(Item(path, key, Fate.DROPPED, kind if is_prim else name))

    def _look_at(self, prim: Any, names: Iterable[str]) -> None:
        path, kind = str(prim.GetPath()), str(prim.GetTypeName())
        self._types[path] = kind or "prim"
        fate, word = self._fate_of(prim, path, kind)
        is_shader = fate == Fate.DROPPED and prim.IsA(UsdShade.Shader)
        if is_shader:
            word = str(UsdShade.Shader(prim).GetIdAttr().Get() or prim.GetName())
            self._drop(path, "", "shaders", word)
        elif fate == Fate.DROPPED:
            self._drop(path, "", word, object_name(prim, self._known), is_prim=True)
            self.others[kind] += word == kind
        else:
            self.items.append(Item(path, "", fate))
        if is_shader or "Light" in kind:
            self._note_textures(prim, names)
        if fate not in (Fate.CODED, Fate.COMPOSED):
            # Properties and metadata of a prim share its fate.
            self.items += [Item(f"{path}.{name}", "", fate, word) for name in names]
            self.items += [Item(path, key, fate, word) for key in prim.GetAllAuthoredMetadata()]
            return
        left_out = self._left_out.get(path, set())
        for name in names:
            self._look_at_property(prim, kind, name, left_out)
        self._look_at_metadata(path, prim.GetAllAuthoredMetadata(), _PRIM_METADATA, "metadata of prims")
        for schema in prim.GetAppliedSchemas():
            if schema.partition(":")[0] not in _READ_SCHEMAS:
                self._drop(path, schema, "API schemas", schema)
        for each in prim.GetVariantSets().GetNames():
            variants = prim.GetVariantSet(each)
            for one in variants.GetVariantNames():
                if one != variants.GetVariantSelection():
                    self._drop(path, f"{each}={one}", "variants that are not selected", f"{each}={one}")

    def _fate_of(self, prim: Any, path: str, kind: str) -> tuple[Fate, str]:
        """Return what happens to a prim, and the word for it if it is dropped."""
        if path in self._applied:
            return Fate.APPLIED, ""
        if prim.GetPath() in self._within:
            return Fate.CODED, ""
        if object_name(prim, self._known) in self._refused:
            return Fate.TOLD, ""
        if prim.IsA(UsdGeom.Gprim) and UsdGeom.Imageable(prim).ComputePurpose() not in ("default", "render"):
            return Fate.TOLD, ""
        if not prim.IsActive():
            return Fate.DROPPED, "inactive prims"
        if prim.IsAbstract():
            return Fate.COMPOSED, ""
        if not prim.IsDefined():
            return Fate.DROPPED, "prims that are not defined"
        if prim.IsA(UsdGeom.Subset) and prim.GetParent().GetPath() in self._within:
            of_shape = self._left_out.get(str(prim.GetParent().GetPath()), set())
            return Fate.TOLD if f"subset {prim.GetName()}" in of_shape else Fate.CODED, ""
        if prim.IsA(UsdShade.Material) and prim.GetPath() in self._bound:
            return Fate.CODED, ""
        if kind in _STRUCTURE:
            return (Fate.COMPOSED, "") if prim.GetAllChildren() else (Fate.DROPPED, "prims without geometry")
        return Fate.DROPPED, kind

    def _look_at_property(self, prim: Any, kind: str, name: str, left_out: set[str]) -> None:
        path = f"{prim.GetPath()}.{name}"
        if (told := _left_out_as(name, left_out)) is not None:
            self.items.append(Item(path, "", Fate.DROPPED, told))
            return
        fate = self._fate_of_property(prim, kind, name)
        if fate == Fate.DROPPED:
            attribute = prim.GetAttribute(name)
            what = "attributes" if attribute else "relationships"
            moves = bool(attribute) and attribute.ValueMightBeTimeVarying()
            what = "properties of materials" if prim.IsA(UsdShade.Material) else what
            self._drop(path, "", what, name + " (it changes with time)" * moves)
        else:
            self.items.append(Item(path, "", fate))

    def _fate_of_property(self, prim: Any, kind: str, name: str) -> Fate:
        space = name.partition(":")[0]
        if name in _EVERYWHERE:
            is_shown = name == "visibility" and _is_default(prim, name)
            return Fate.DEFAULT if is_shown else _EVERYWHERE[name]
        if prim.GetAttribute(name) and not prim.GetAttribute(name).HasAuthoredValue():
            return Fate.DEFAULT if _is_default(prim, name) else Fate.DROPPED
        if space in ("xformOp", "subsetFamily", OWN) or name in _READ.get(kind, "").split():
            return Fate.CODED
        if _binds(name):
            return Fate.CODED
        if name.startswith(("skel:", "primvars:skel:")):
            return Fate.APPLIED if self._applied else Fate.DROPPED
        if space == "primvars":
            primvar = UsdGeom.Primvar(prim.GetAttribute(name.removesuffix(":indices")))
            # Shapes inherit the constant primvars of their ancestors.
            is_read = str(prim.GetPath()) in self._left_out or (primvar and primvar.GetInterpolation() == "constant")
            return Fate.CODED if is_read and kind != "PointInstancer" else Fate.DROPPED
        return Fate.DEFAULT if _is_default(prim, name) else Fate.DROPPED

    def _note_textures(self, prim: Any, names: Iterable[str]) -> None:
        for name in names:
            attribute = prim.GetAttribute(name)
            if attribute and attribute.GetTypeName() == Sdf.ValueTypeNames.Asset:
                asset = attribute.Get()
                if asset and asset.path:
                    self._textures[PurePosixPath(asset.path).name] = None

    def _look_at_metadata(self, path: str, found: dict[str, Any], known: dict[str, Fate], kind: str) -> None:
        for key, value in found.items():
            if key in ("customData", "customLayerData"):
                rest = [name for name in value if name not in _OWN_DATA]
                for name in rest:
                    self._drop(path, key, kind, f"{key}:{name}")
                if not rest:
                    self.items.append(Item(path, key, Fate.CODED))
            elif key in known or (key == "displayName" and value == found.get("customData", {}).get(NAME)):
                self.items.append(Item(path, key, known.get(key, Fate.CODED)))
            else:
                self._drop(path, key, kind, key)


def _left_out_as(name: str, left_out: set[str]) -> str | None:
    """Return the name by which a shape reports a property that it does not keep; None if it keeps it."""
    word = _BY_SHAPE.get(name, name.removeprefix("primvars:").removesuffix(":indices"))
    return next((one for one in left_out if one == word or one.startswith(f"{word} (")), None)


def _binds(name: str) -> bool:
    """Return whether a relationship binds a material to a prim for all purposes."""
    return name == BINDING or (name.startswith(f"{BINDING}:collection:") and name.count(":") == BINDING.count(":") + 2)


def _is_default(prim: Any, name: str) -> bool:
    """Return whether an attribute has its schema's fallback value."""
    attribute = prim.GetAttribute(name)
    if not attribute or attribute.ValueMightBeTimeVarying() or attribute.HasAuthoredConnections():
        return False
    found = attribute.Get()
    return found is None or np.array_equal(found, prim.GetPrimDefinition().GetAttributeFallbackValue(name))
