"""Read values of XDMF: DataItems in XML, HDF5 or binary files, whole or as part of an array."""

from __future__ import annotations

import bz2
import math
import re
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.arrays.hdf5 import check_stored, linked_item
from pdecodec.formats.vtk.xdmf_document import Document, Element
from pdecodec.system.reading import read_at_most

_JOIN = re.compile(r"JOIN\(\s*(?P<parts>\$\d+(?:\s*[,;]\s*\$\d+)*)\s*\)", re.IGNORECASE)
"""The function that makes items the columns of one array."""

_KINDS = {"FLOAT": "f", "INT": "i", "UINT": "u", "CHAR": "i", "UCHAR": "u", "SHORT": "i", "USHORT": "u"}
"""NumPy's kinds of numbers by NumberType."""

_SIZES = {"CHAR": 1, "UCHAR": 1, "SHORT": 2, "USHORT": 2}
"""Default size of a number by type [bytes], if Precision is missing; 4 for other types."""

_ORDERS = {"BIG": ">", "LITTLE": "<", "NATIVE": "=", "": "="}

_DECOMPRESSORS: dict[str, Callable[[BinaryIO, int], bytes]] = {
    "": read_at_most,
    "RAW": read_at_most,
    "ZLIB": lambda file, most: zlib.decompressobj().decompress(file.read(), max(1, most)),
    "BZIP2": lambda file, most: bz2.BZ2Decompressor().decompress(file.read(), most),
}
"""Functions that decompress a file, by Compression, to at most a given number of bytes."""

Selection = tuple[slice, ...]


class Items:
    """Values of the DataItems of a document; HDF5 files stay open until :meth:`close`.

    Parameters
    ----------
    document : Document
    """

    def __init__(self, document: Document) -> None:
        self._document, self._path = document, document.path
        self._files: dict[Path, Any] = {}
        self._checked: set[tuple[Path, str]] = set()

    def of(self, element: Element) -> list[Element]:
        """Return the DataItems of an element."""
        return self._document.children(element, "DataItem")

    def only(self, element: Element) -> NDArray[Any]:
        """Return the values of the only DataItem of an element; InputError if there are none or several."""
        found = self.of(element)
        if len(found) != 1:
            name = element.get("Name", "")
            raise self._refused(f"{element.tag} {name!r} has {len(found)} DataItems, and one is read")
        return self.numbers(found[0])

    def key(self, element: Element) -> tuple[str, ...]:
        """Return a key that is equal for elements that refer to the same data or contain the same text."""
        texts = []
        for item in element.iter("DataItem"):
            found = self._document.resolved(item)
            folder = str(self._document.folder(found))
            texts.append(" ".join((folder, (found.text or "").strip(), *(f"{k}={v}" for k, v in found.items()))))
            texts += self.key(found) if found is not item else ()
        return tuple(texts)

    def numbers(self, item: Element) -> NDArray[Any]:
        """Return the values of a DataItem, in the shape that its Dimensions declare.

        Raises
        ------
        InputError
            If its kind is not supported, or its data are missing or not of the declared size.
        """
        kind = item.get("ItemType", item.get("Type", "Uniform")).lower()
        if kind == "hyperslab":
            values = self._read_slab(item)
        elif kind == "function":
            values = self._function(item)
        elif kind == "uniform":
            values = self._uniform(item, None)
        else:
            raise self._refused(f"a DataItem of type {kind} is not read")
        return self._reshape(values, item)

    def close(self) -> None:
        for file in self._files.values():
            file.close()
        self._files = {}

    def _refused(self, message: str) -> InputError:
        return InputError(
            f"{message}; write it as uniform items of XML or HDF", code="unsupported-feature", path=self._path
        )

    def _shape(self, item: Element) -> tuple[int, ...] | None:
        declared = item.get("Dimensions")
        return None if declared is None else tuple(int(part) for part in declared.split())

    def _reshape(self, values: NDArray[Any], item: Element) -> NDArray[Any]:
        shape = self._shape(item)
        if shape is None:
            return values
        if math.prod(shape) != values.size:
            declared, place = item.get("Dimensions"), " ".join((item.text or "").split())[:60]
            raise damaged(
                f"a DataItem ({place}) declares Dimensions {declared!r}, its data are {values.size} numbers; "
                "write it again",
                path=self._path,
            )
        return values.reshape(shape)

    def _uniform(self, item: Element, selection: Selection | None) -> NDArray[Any]:
        """Return the values of an item that holds them itself, or a selection of them."""
        form = item.get("Format", "XML").upper()
        if form == "HDF":
            return self._of_hdf5(item, selection)
        if form == "XML":
            values = np.array((item.text or "").split(), np.float64)
        elif form == "BINARY":
            values = self._of_binary(item)
        else:
            raise self._refused(f"data of format {item.get('Format')} is not read")
        return values if selection is None else self._reshape(values, item)[selection]

    def _of_hdf5(self, item: Element, selection: Selection | None) -> NDArray[Any]:
        text = (item.text or "").strip()
        name, _, place = text.partition(":")
        place, *parts = place.split("|")
        if parts:
            # XDMF 3: start, stride and count of a part, and the shape of the whole.
            if len(parts) != 4 or selection is not None:
                raise self._refused(f"the part of a dataset {text!r} is not understood")
            start, stride, count, _ = ([int(number) for number in part.split()] for part in parts)
            selection = _selection(start, stride, count)
        scope = self._document.scope
        file = self._open(name, self._document.folder(item))
        dataset = linked_item(file, place, scope)
        if not isinstance(dataset, h5py.Dataset):
            raise damaged(f"{name!r} has no dataset {place!r}; write it again", path=self._path)
        key = Path(file.filename), place
        if key not in self._checked:
            check_stored(dataset, scope)
            self._checked.add(key)
        if selection is None:
            return np.asarray(dataset[()])
        declared = self._shape(item)
        if declared is not None and not parts and declared != dataset.shape:
            raise damaged(
                f"dataset {text!r} has shape {dataset.shape}, and {declared} is declared; write it again",
                path=self._path,
            )
        return np.asarray(dataset[self._check_selection(selection, dataset.shape)])

    def _open(self, name: str, folder: Path) -> Any:
        path = folder / name
        if path not in self._files:
            self._files[path] = h5py.File(self._document.scope.regular(name, folder), "r")
        return self._files[path]

    def _of_binary(self, item: Element) -> NDArray[Any]:
        """Return the values of a raw binary file, from the byte ``Seek`` on."""
        name, shape = (item.text or "").strip(), self._shape(item)
        number = item.get("NumberType", item.get("DataType", "Float")).upper()
        packing, order = item.get("Compression", "").upper(), item.get("Endian", "").upper()
        if number not in _KINDS or packing not in _DECOMPRESSORS or order not in _ORDERS or shape is None:
            raise self._refused(f"the binary data in {name!r} ({dict(item.items())}) are not read")
        size = int(item.get("Precision", _SIZES.get(number, 4)))
        dtype = np.dtype(f"{_ORDERS[order]}{_KINDS[number]}{size}")
        wanted = math.prod(shape) * dtype.itemsize
        with self._document.scope.open(name, self._document.folder(item)) as file:
            file.seek(int(item.get("Seek", "0").split()[0]))
            raw = _DECOMPRESSORS[packing](file, wanted)
        if len(raw) < wanted:
            raise InputError(
                f"{name!r} ends before the {math.prod(shape)} numbers of an item", code="damaged-input", path=self._path
            )
        return np.frombuffer(raw[:wanted], dtype).astype(dtype.newbyteorder("="))

    def _read_slab(self, item: Element) -> NDArray[Any]:
        """Return the values of a part of another item: start, stride and count per axis."""
        parts = self.of(item)
        if len(parts) != 2:
            raise self._refused(f"a HyperSlab has {len(parts)} DataItems, but needs two: the selection and its source")
        start, stride, count = self.numbers(parts[0]).reshape(3, -1).astype(np.int64).tolist()
        selection, source = _selection(start, stride, count), parts[1]
        if source.get("ItemType", source.get("Type", "Uniform")).lower() == "uniform":
            values = self._uniform(source, selection)
        else:
            whole = self.numbers(source)
            values = whole[self._check_selection(selection, whole.shape)]
        if values.shape != tuple(count):
            raise damaged(f"a HyperSlab selects {count} values of fewer; write it again", path=self._path)
        return values

    def _check_selection(self, selection: Selection, shape: Sequence[int]) -> Selection:
        if len(selection) != len(shape) or any(part.stop > size for part, size in zip(selection, shape, strict=True)):
            raise InputError(
                f"a part is outside its data, which have shape {tuple(shape)}", code="damaged-input", path=self._path
            )
        return selection

    def _function(self, item: Element) -> NDArray[Any]:
        """Return the columns of JOIN($0, $1, ...), the only supported function."""
        text = item.get("Function", "").strip()
        found = _JOIN.fullmatch(text)
        parts = [self.numbers(one) for one in self.of(item)]
        numbers = [] if found is None else [int(part.strip(" $")) for part in re.split("[,;]", found["parts"])]
        if not numbers or max(numbers) >= len(parts):
            raise self._refused(f"the function {text!r} is not read")
        columns = [parts[number].reshape(-1) for number in numbers]
        shape = self._shape(item)
        if len({column.size for column in columns}) != 1 or shape != (columns[0].size, len(columns)):
            raise self._refused(f"the function {text!r} of items that are not one number an element is not read")
        return np.stack(columns, axis=1)


def _selection(start: Sequence[int], stride: Sequence[int], count: Sequence[int]) -> Selection:
    """Return slices that end just after the last value taken, so that `stop` shows how far they reach."""
    if min(*start, *count, 0) < 0 or min(stride) < 1:
        raise ValueError("a part of an array begins before it")
    return tuple(
        slice(first, first + step * (number - 1) + 1 if number else first, step)
        for first, step, number in zip(start, stride, count, strict=True)
    )
