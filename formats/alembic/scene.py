"""Cut the motion out of an Alembic archive, and fill it again: blocks of its file, in place.

Blocks of positions, normals and bounds become zeros, and so do blocks of arrays that the decoder restores, which are
filled again. Keys become zeros. The rest of the file stays as it is, so that the library reads the archive as
before.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import imath
import numpy as np
from alembic3d import Abc
from numpy.typing import NDArray

from pdecodec.errors import damaged
from pdecodec.formats.alembic.ogawa import KEY_BYTES, blocks
from pdecodec.formats.alembic.onto import moved_shapes
from pdecodec.formats.alembic.reader import AlembicSequence
from pdecodec.formats.alembic.values import to_numpy
from pdecodec.formats.base.carried_fields import StoredFields
from pdecodec.formats.base.carrying import Stripped, arrays_of, open_fields
from pdecodec.formats.base.onto import Fitted
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.reading import read_regular

ROOT = "scene.abc"
"""Name of the archive in a carrier."""

_FEWEST_BYTES = 48
"""Smallest size of a block that is worth cutting [bytes]: that of bounds."""

_OF_MOTION = (".geom/P", ".geom/N", ".geom/N/.vals", ".geom/.selfBnds")
"""Properties of a shape that the motion replaces."""

_NOUNS = {"Camera": "camera", "Light": "light", "Material": "material"}


class AlembicFamily:
    """Cutting and filling of Alembic archives."""

    def strip(
        self,
        original: AlembicSequence,
        source: Path,
        fits: Sequence[Fitted],
        *,
        exact_uvs: bool,
        fields: StoredFields,
    ) -> Stripped:
        """Return the file of an archive without coded arrays."""
        data = bytearray(read_regular(source))
        known: dict[bytes, list[Any]] = {}
        for number, one in enumerate(fits):
            for key, values in arrays_of(one.item, exact_uvs=exact_uvs):
                known.setdefault(values.tobytes(), [number, *key])
        moved = moved_shapes(original, fits, keeps_instances=True)
        places = {
            (original.shapes[fits[number].index].node.getFullName(), source.place): (name, number)
            for name, number, source in fields.sources()
        }
        replaced, kept, coded = set[bytes](), set[bytes](), dict[bytes, tuple[Any, ...]]()
        for path, name, time, values in _samples(original.top):
            content, owner = values.tobytes(), places.get((path, name))
            seconds = None if owner is None or not len(values) else fields.seconds(time)
            if owner is not None and coded.get(content, owner)[:2] == owner and seconds is not None:
                rows = values.reshape(len(values), -1)
                if content in coded or fields.is_stored(*owner, time, rows):
                    coded[content] = (*owner, values.dtype.str, len(values), time, seconds)
                    continue
            (replaced if path in moved and name in _OF_MOTION else kept).add(content)
        arrays, samples = [], []
        for place, size in blocks(data):
            content = bytes(memoryview(data)[place : place + size])
            if size < _FEWEST_BYTES:
                continue
            if content in known:
                arrays.append([place, *known[content]])
            elif content in coded and content not in kept:
                samples.append([place, *coded[content]])
            if content in known or (content not in kept and (content in replaced or content in coded)):
                data[place : place + size] = bytes(size)
            if content in known or content in replaced or content in kept or content in coded:
                # The library compares keys when it writes samples, but ignores them when it reads.
                data[place - KEY_BYTES : place] = bytes(KEY_BYTES)
        counts = Counter(_nouns(original.top))
        cuts = {"arrays": arrays, "samples": samples}
        names = tuple(dict.fromkeys(name for _, name, *_ in samples))
        return Stripped({ROOT: bytes(data)}, ROOT, cuts, dict(sorted(counts.items())), fields=names)

    def fill(self, folder: Path, cuts: Mapping[str, Any], sequence: MeshSequence, suffix: str) -> None:
        """Fill the archive in a folder."""
        known: dict[tuple[Any, ...], bytes] = {}
        for number, item in enumerate(sequence.objects):
            known.update({(number, *key): values.tobytes() for key, values in arrays_of(item)})
        size = (folder / ROOT).stat().st_size
        with (folder / ROOT).open("r+b") as file:
            for place, *key in cuts["arrays"]:
                _write(file, place, known[tuple(key)], size)
        if cuts.get("samples"):
            with (
                open_fields(folder / ROOT, sequence, {name for _, name, *_ in cuts["samples"]}) as fields,
                (folder / ROOT).open("r+b") as file,
            ):
                for place, name, number, dtype, count, time, seconds in sorted(cuts["samples"], key=_by_frame):
                    if not 0 <= count <= size:  # before rows take memory
                        raise damaged("the scene does not fit the meshes of the file")
                    _write(file, place, fields.at(name, number, time, seconds, count, dtype).tobytes(), size)


def _by_frame(sample: Sequence[Any]) -> tuple[Any, ...]:
    """Return by what samples are sorted, so that all objects of a frame follow each other."""
    return sample[1], sample[6]


def _write(file: Any, place: int, content: bytes, size: int) -> None:
    """Write bytes into a file of a known size."""
    if not 0 <= place <= size - len(content):
        raise damaged("the scene does not fit the meshes of the file")
    file.seek(place)
    file.write(content)


def _objects(top: Any) -> Iterator[Any]:
    left = [top]
    while left:
        item = left.pop()
        left += [item.getChild(index) for index in range(item.getNumChildren())]
        yield item


def _samples(top: Any) -> Iterator[tuple[str, str, float, NDArray[Any]]]:
    """Yield for every sample of numbers: the path of the object, the name of the property, the time [s], the values."""
    for item in _objects(top):
        properties = [("", item.getProperties())]
        while properties:
            above, owner = properties.pop()
            for index in range(owner.getNumProperties()):
                header = owner.getPropertyHeader(index)
                name = header.getName()
                if header.isCompound():
                    properties.append((f"{above}{name}/", Abc.ICompoundProperty(owner, name)))
                else:
                    kind = Abc.IArrayProperty if header.isArray() else Abc.IScalarProperty
                    found = _of_property(kind(owner, name))
                    yield from ((item.getFullName(), f"{above}{name}", *one) for one in found)


def _of_property(stored: Any) -> Iterator[tuple[float, NDArray[Any]]]:
    sampling = stored.getTimeSampling()
    for index in range(stored.getNumSamples()):
        time = float(sampling.getSampleTime(index))
        try:
            found = stored.getValue(Abc.ISampleSelector(time))
        except RuntimeError:
            return  # numbers that the Python binding has no type for
        if isinstance(found, imath.Box3d):
            yield time, np.array([tuple(found.min()), tuple(found.max())])
        elif isinstance(found, imath.M44d):
            yield time, np.array(found, np.float64)
        elif not isinstance(stored, Abc.IArrayProperty):
            return
        elif (values := to_numpy(found)).dtype.kind in "fiu":
            yield time, values


def _nouns(top: Any) -> Iterator[str]:
    for item in _objects(top):
        if item.isInstanceRoot():
            yield "instance"
        schema = item.getMetaData().get("schema")
        yield from (noun for word, noun in _NOUNS.items() if word in schema)
