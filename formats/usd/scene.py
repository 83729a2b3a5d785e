"""Cut the motion out of the layers of a USD stage, and fill them again: the root layer, layers next to it, packages.

Points become zeros at one time, and normals are removed. Faces and primvars become empty arrays where the decoder
restores the same values.
"""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Sdf, Usd, UsdGeom, UsdUtils

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.carried_fields import StoredFields
from pdecodec.formats.base.carrying import (
    COUNTS,
    INDICES,
    Stripped,
    arrays_of,
    free_name,
    is_carried_name,
    is_companion_name,
    open_fields,
)
from pdecodec.formats.base.onto import Fitted
from pdecodec.formats.base.scene_reading import listed
from pdecodec.formats.usd.composition import stage_errors
from pdecodec.formats.usd.layers import layer_files
from pdecodec.formats.usd.reader import UsdSequence
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.reading import read_regular

PACKAGE = "scene.usdz"
"""Name of the package that is made of the files of a carrier."""

_FEWEST = 4
"""Smallest size of an array that is worth cutting."""

_REPLACED = {"points": "zeros", "normals": "nothing", "primvars:normals": "nothing", "extent": "gone"}
"""What replaces the values that the motion gives."""

_SHAPING = ("points", COUNTS, INDICES, "curveVertexCounts")
"""Attributes without which a prim is another shape."""

_NOUNS = {"PointInstancer": "instance", "Camera": "camera", "Material": "material", "Skeleton": "skeleton"}


class UsdFamily:
    """Cutting and filling of USD stages."""

    def strip(
        self, original: UsdSequence, source: Path, fits: Sequence[Fitted], *, exact_uvs: bool, fields: StoredFields
    ) -> Stripped:
        """Return the layers of a stage without coded arrays, and the other files of a package."""
        stage = original.stage
        shapes = [original.shapes[one.index] for one in fits]
        is_package = source.suffix.lower() == ".usdz"
        files, outside = _files_of(source, is_package=is_package)
        root = next(iter(files)) if is_package else source.name
        names = {layer: _name_of(layer, source, root, is_package=is_package) for layer in stage.GetUsedLayers()}
        if outside:
            _check_shapes_inside([shape.prim for shape in shapes], {layer for layer in names if names[layer] in files})
        arrays: list[list[Any]] = []
        samples: list[list[Any]] = []
        coded = {(number, one.place): name for name, number, one in fields.sources()}
        kept = _kept_specs(stage, {one.prim.GetPath() for one in shapes if not one.is_instance})
        with stage_errors(source), tempfile.TemporaryDirectory(prefix="pdecodec-") as room:
            bare: dict[str, Any] = {}
            for number, (shape, one) in enumerate(zip(shapes, fits, strict=True)):
                known = {_key(values): key for key, values in reversed([*arrays_of(one.item, exact_uvs=exact_uvs)])}
                if shape.is_instance:
                    continue
                for spec, kind in _cut_specs(shape.prim, kept, {place for owner, place in coded if owner == number}):
                    name = names.get(spec.layer)
                    if name not in files:
                        continue
                    if name not in bare:
                        bare[name] = Sdf.Layer.CreateAnonymous(f"layer{Path(name).suffix}")
                        bare[name].TransferContent(spec.layer)
                    copy = bare[name].GetAttributeAtPath(spec.path)
                    cut = _cut(copy, kind, known)
                    if cut is not None:
                        arrays.append([name, str(spec.path), number, *cut])
                    elif (field := coded.get((number, spec.name))) is not None:
                        cut_samples = _cut_samples(copy, fields, field, number)
                        samples += [[name, str(spec.path), field, number, *one] for one in cut_samples]
            for number, (name, layer) in enumerate(bare.items()):
                place = Path(room, f"{number}{Path(name).suffix}")
                layer.Export(str(place))
                files[name] = place.read_bytes()
        cuts = {"arrays": arrays, "samples": samples, **({"package": list(files)} if is_package else {})}
        companions = tuple(name for name in files if name != root)
        used = tuple(dict.fromkeys(field for _, _, field, *_ in samples))
        return Stripped(files, root, cuts, _contents(stage, files), companions, outside, used)

    def fill(self, folder: Path, cuts: dict[str, Any], sequence: MeshSequence, suffix: str) -> None:
        """Fill the layers in a folder; for a package, pack them."""
        with _layers_to_fill(folder) as layer_of:
            for name, path, number, *cut in cuts["arrays"]:
                spec = layer_of(name).GetAttributeAtPath(path)
                known = {tuple(key): values for key, values in arrays_of(sequence.objects[number])}
                _set(spec, _typed(spec, known[tuple(cut)]))
        if cuts.get("samples"):
            names = {field for _, _, field, *_ in cuts["samples"]}
            # All objects of a frame follow each other.
            by_frame = sorted(cuts["samples"], key=lambda one: (one[2], one[6]))
            with open_fields(folder / cuts["root"], sequence, names) as fields, _layers_to_fill(folder) as layer_of:
                for name, path, field, number, dtype, code, seconds, count in by_frame:
                    spec = layer_of(name).GetAttributeAtPath(path)
                    shape = np.array(spec.layer.QueryTimeSample(spec.path, code)).shape
                    if shape[:1] != (count,):  # before rows take memory
                        raise damaged("the scene does not fit the meshes of the file")
                    rows = fields.at(field, number, code, seconds, count, dtype)
                    spec.layer.SetTimeSample(spec.path, code, _typed(spec, rows.reshape(shape)))
        is_package = suffix.lower() == ".usdz"
        if is_package and "package" in cuts:
            package = free_name(folder / PACKAGE)
            with Sdf.ZipFileWriter.CreateNew(str(package)) as writer:
                for name in cuts["package"]:
                    if not is_carried_name(name):
                        raise ValueError(f"{name} is no name of a file")
                    if not writer.AddFile(str(folder / name), name):
                        raise damaged("the scene cannot be packed again")
            cuts["root"] = package.name
        elif is_package:
            *_, absent = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(folder / cuts["root"])))
            if absent:
                listed_names = listed(sorted({Path(one).name for one in absent}))
                message = f"a package holds the files that the scene only names: {listed_names}"
                raise InputError(message, code="unsupported-feature")
        if is_package:
            cuts["companions"] = []


@contextmanager
def _layers_to_fill(folder: Path) -> Iterator[Callable[[str], Any]]:
    """Yield a function that opens layers in a folder by name; write them at the end."""
    layers: dict[str, Any] = {}

    def layer_of(name: str) -> Any:
        if name not in layers:
            if not is_carried_name(name):
                raise ValueError(f"{name} is no name of a file")
            layers[name] = Sdf.Layer.FindOrOpen(str(folder / name))
        return layers[name]

    yield layer_of
    for name, layer in layers.items():
        # A binary file that is saved again would keep its previous content.
        whole = free_name(folder / f"whole{Path(name).suffix}")
        layer.Export(str(whole))
        whole.replace(folder / name)


def _files_of(source: Path, *, is_package: bool) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """Return the files of a stage by name relative to its root layer, and the names of files elsewhere."""
    if is_package:
        with zipfile.ZipFile(source) as package:
            if any(item.compress_type != zipfile.ZIP_STORED for item in package.infolist()):
                raise InputError("is a package with compressed files", code="unsupported-feature", path=source)
            found = {name: package.read(name) for name in package.namelist() if not name.endswith("/")}
        if bad := next((name for name in found if not is_carried_name(name)), None):
            raise InputError(f"the package has a file {bad!r}", code="unsupported-feature", path=source)
        return found, ()
    folder, files, outside = source.resolve().parent, {source.name: read_regular(source)}, []
    for path in layer_files(source):
        place = path.resolve()
        name = _name_in(folder, place)
        if is_companion_name(name):
            files.setdefault(name, read_regular(place))
        else:
            outside.append(path.name)
    return files, tuple(dict.fromkeys(outside))


def _name_of(layer: Any, source: Path, first: str, *, is_package: bool) -> str:
    """Return the name of a layer relative to the root layer, or in its package, whose first file is `first`."""
    place = Path(layer.realPath).resolve() if layer.realPath else Path()
    if is_package:
        inside = Ar.SplitPackageRelativePathInner(layer.identifier)[1]
        return str(inside) or (first if place == source.resolve() else "")
    return _name_in(source.resolve().parent, place)


def _name_in(folder: Path, place: Path) -> str:
    """Return the name of a file relative to a folder; empty if it is elsewhere."""
    return place.relative_to(folder).as_posix() if place.is_relative_to(folder) else ""


def _check_shapes_inside(prims: Sequence[Any], layers: Collection[Any]) -> None:
    """Raise InputError if other layers than those in `layers` define or place a prim: without them it would be lost,
    or be written to another place.
    """
    checked = set[Any]()
    for prim in prims:
        above = prim
        while above.GetPath() not in checked and not above.IsPseudoRoot():
            checked.add(above.GetPath())
            specs = above.GetPrimStack()
            inside = [one for one in specs if one.layer in layers]
            used = [
                spec
                for one in above.GetAuthoredAttributes()
                if one.GetName() in _SHAPING or one.GetName().startswith("xformOp")
                for spec in one.GetPropertyStack(Usd.TimeCode.Default())
            ]
            if (
                all(one.specifier == Sdf.SpecifierOver for one in inside)
                or (above.GetTypeName() and not any(one.typeName for one in inside))
                or any(one.layer not in layers for one in used)
            ):
                names = {Path(one.layer.realPath).name: None for one in (*specs, *used) if one.layer not in layers}
                message = (
                    f"layers outside the folder of the stage define or place {above.GetPath()}: {listed(list(names))}"
                )
                raise InputError(f"{message}; move them into it", code="unsupported-feature")
            above = above.GetParent()


def _kept_specs(stage: Any, moved: set[Any]) -> set[tuple[str, Any]]:
    """Return the layers and paths of the specs that remaining geometry uses."""
    return {
        (spec.layer.identifier, spec.path)
        for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
        if prim.GetPath() not in moved and UsdGeom.PointBased(prim)
        for attribute in prim.GetAuthoredAttributes()
        for spec in attribute.GetPropertyStack(Usd.TimeCode.Default())
    }


def _cut_specs(prim: Any, kept: set[tuple[str, Any]], coded: Collection[str]) -> Iterator[tuple[Any, str]]:
    """Yield the specs of those arrays of a moved prim that no remaining prim uses, and how each is cut.

    Attributes in `coded` are fields.
    """
    for attribute in prim.GetAuthoredAttributes():
        name = attribute.GetName()
        kind = _REPLACED.get(name, "known")
        if kind != "known" or name in (COUNTS, INDICES) or name in coded or name.startswith("primvars:"):
            for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()):
                if (spec.layer.identifier, spec.path) not in kept:
                    yield spec, kind


def _cut(spec: Any, kind: str, known: dict[bytes, tuple[str, str]]) -> tuple[str, str] | None:
    """Cut the values of a spec; return the array of the object that held the same values, if there was one."""
    samples = spec.layer.ListTimeSamplesForPath(spec.path)
    first = spec.layer.QueryTimeSample(spec.path, samples[0]) if samples else spec.default
    if kind == "gone":
        for code in samples:
            spec.layer.EraseTimeSample(spec.path, code)
        return None
    if first is None or isinstance(first, Sdf.ValueBlock):
        return None
    if kind != "known":
        for code in samples:
            spec.layer.EraseTimeSample(spec.path, code)
        count = len(first) if kind == "zeros" else 0
        spec.default = type(first)(count)
        return None
    if len(samples) > 1 or (samples and spec.default is not None) or not hasattr(first, "__len__"):
        return None
    values = np.array(first)
    cut = known.get(_key(values)) if values.size >= _FEWEST and values.dtype.kind in "fi" else None
    if cut is not None:
        _set(spec, type(first)())
    return cut


def _cut_samples(spec: Any, fields: StoredFields, name: str, number: int) -> Iterator[tuple[Any, ...]]:
    """Replace samples that a field restores; yield type, time code, time [s] and number of rows of each.

    Each sample becomes one number, 0, 1, 2...: if all were equal, the attribute would be read as constant.
    """
    for index, code in enumerate(spec.layer.ListTimeSamplesForPath(spec.path)):
        stored = spec.layer.QueryTimeSample(spec.path, code)
        if isinstance(stored, Sdf.ValueBlock) or not hasattr(stored, "__len__"):
            continue
        values, seconds = np.array(stored), fields.seconds(code)
        if seconds is None or values.size < _FEWEST or values.dtype.kind not in "fiu":
            continue
        if fields.is_stored(name, number, code, values.reshape(len(values), -1)):
            spec.layer.SetTimeSample(spec.path, code, _typed(spec, np.full_like(values, index % 100)))
            yield values.dtype.str, code, seconds, len(values)


def _set(spec: Any, values: Any) -> None:
    """Replace the only value of a spec."""
    samples = spec.layer.ListTimeSamplesForPath(spec.path)
    if samples:
        spec.layer.SetTimeSample(spec.path, samples[0], values)
    else:
        spec.default = values


def _typed(spec: Any, values: NDArray[Any]) -> Any:
    """Return an array converted to the type of a spec."""
    return type(spec.typeName.defaultValue).FromNumpy(np.ascontiguousarray(values))


def _key(values: NDArray[Any]) -> bytes:
    return f"{values.dtype} {values.shape} ".encode() + np.ascontiguousarray(values).tobytes()


def _contents(stage: Any, files: dict[str, bytes]) -> dict[str, int]:
    found: dict[str, int] = {}
    for prim in stage.TraverseAll():
        kind = str(prim.GetTypeName())
        noun = "light" if kind.endswith("Light") else "instance" if prim.IsInstance() else _NOUNS.get(kind)
        if noun is not None:
            found[noun] = found.get(noun, 0) + 1
    textures = [name for name in files if not Sdf.FileFormat.FindByExtension(Path(name).suffix[1:])]
    return {**dict(sorted(found.items())), "texture": len(textures)}
