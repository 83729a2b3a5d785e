"""Read values of XDMF: DataItems in XML, HDF5 or binary files, whole or as part of an array."""

from __future__ import annotations

import bz2
import contextlib
import math
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.arrays.hdf5 import check_stored, linked_item
from pdecodec.formats.vtk.xdmf_document import Document, Element
from pdecodec.system.reading import read_at_most

_JOIN = re.compile(r"JOIN\(\s*(?P<parts>\$\d+(?:\s*[,;]\s*\$\d+)*)\s*\)", re.IGNORECASE)
"""Pattern of the function that joins items as the columns of one array."""

_KINDS = {"FLOAT": "f", "INT": "i", "UINT": "u", "CHAR": "i", "UCHAR": "u", "SHORT": "i", "USHORT": "u"}
"""NumPy's kinds of numbers by NumberType."""

_SIZES = {"CHAR": 1, "UCHAR": 1, "SHORT": 2, "USHORT": 2}
"""Default size of a number by type [bytes], if Precision is missing; 4 for other types."""

_ORDERS: Mapping[str, Literal[">", "<", "="]] = {"BIG": ">", "LITTLE": "<", "NATIVE": "=", "": "="}

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
        self._dtypes: dict[tuple[tuple[str, str], ...], np.dtype[Any]] = {}

    def of(self, element: Element) -> list[Element]:
        """Return the DataItems of an element."""
        return self._document.children(element, "DataItem")

    def only(self, element: Element) -> NDArray[Any]:
        """Return the values of an element's only DataItem; InputError if it has none or several."""
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
        kind = _kind(item)
        if kind == "hyperslab":
            values = self._read_slab(item)
        elif kind == "function":
            values = self._function(item)
        elif kind == "uniform":
            values = self._uniform(item, None)
        else:
            raise self._refused(f"a DataItem of type {kind} is not read")
        return self._reshape(values, item)

    def layout(self, element: Element) -> tuple[np.dtype[Any], int]:
        """Return the type of the numbers of an element's only DataItem, and how many it declares.

        No values are read, but for XML without Dimensions. Of items of HDF5 that declare the same type one is opened.

        Raises
        ------
        InputError
            If there is not one DataItem, its kind is not supported, or it cannot have so many numbers.
        """
        found = self.of(element)
        if len(found) != 1:
            raise self._refused(f"{element.tag} {element.get('Name', '')!r} has {len(found)} DataItems")
        item = found[0]
        dtype, shape = self._dtype(item), self._shape(item)
        size = self.numbers(item).size if shape is None else math.prod(shape)
        if shape is not None and _form(item) == "XML" and size > len(item.text or ""):
            raise damaged("a DataItem declares more numbers than it has; write it again", path=self._path)
        return dtype, size

    def close(self) -> None:
        for file in self._files.values():
            file.close()
        self._files = {}

    def _dtype(self, item: Element) -> np.dtype[Any]:
        """Return the type of the numbers of a DataItem, in the order of this computer."""
        kind, form = _kind(item), _form(item)
        if kind == "hyperslab":
            return self._dtype(self.of(item)[-1])
        if kind == "function":
            return np.result_type(*map(self._dtype, self.of(item)))
        if form != "HDF":
            return _declared_type(item)
        key = tuple(sorted((name, value) for name, value in item.items() if name not in ("Name", "Dimensions")))
        if key not in self._dtypes:
            self._dtypes[key] = self._dataset((item.text or "").strip().partition("|")[0], item).dtype.newbyteorder("=")
        return self._dtypes[key]

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
        form = _form(item)
        if form == "HDF":
            return self._of_hdf5(item, selection)
        if form == "XML":
            values = _parsed((item.text or "").split(), item)
        elif form == "BINARY":
            values = self._of_binary(item)
        else:
            raise self._refused(f"data of format {item.get('Format')} is not read")
        return values if selection is None else self._reshape(values, item)[selection]

    def _of_hdf5(self, item: Element, selection: Selection | None) -> NDArray[Any]:
        text = (item.text or "").strip()
        address, *parts = text.split("|")
        if parts:
            # XDMF 3: start, stride and count of a part, and the shape of the whole.
            if len(parts) != 4 or selection is not None:
                raise self._refused(f"the part of a dataset {text!r} is not understood")
            start, stride, count, _ = ([int(number) for number in part.split()] for part in parts)
            selection = _selection(start, stride, count)
        dataset = self._dataset(address, item)
        key = Path(dataset.file.filename), address
        if key not in self._checked:
            check_stored(dataset, self._document.scope)
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

    def _dataset(self, address: str, item: Element) -> Any:
        """Return the dataset at ``FILE:PLACE``."""
        name, _, place = address.partition(":")
        dataset = linked_item(self._open(name, self._document.folder(item)), place, self._document.scope)
        if not isinstance(dataset, h5py.Dataset):
            raise damaged(f"{name!r} has no dataset {place!r}; write it again", path=self._path)
        return dataset

    def _open(self, name: str, folder: Path) -> Any:
        path = folder / name
        if path not in self._files:
            self._files[path] = h5py.File(self._document.scope.regular(name, folder), "r")
        return self._files[path]

    def _of_binary(self, item: Element) -> NDArray[Any]:
        """Return the values of a raw binary file, from the byte ``Seek`` on."""
        name, shape = (item.text or "").strip(), self._shape(item)
        packing, order = item.get("Compression", "").upper(), item.get("Endian", "").upper()
        if _number_type(item) not in _KINDS or packing not in _DECOMPRESSORS or order not in _ORDERS or shape is None:
            raise self._refused(f"the binary data in {name!r} ({dict(item.items())}) are not read")
        dtype = _declared_type(item).newbyteorder(_ORDERS[order])
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
        if _kind(source) == "uniform":
            values = self._uniform(source, selection)
        else:
            whole = self.numbers(source)
            values = whole[self._check_selection(selection, whole.shape)]
        if values.shape != tuple(count):
            raise damaged(
                f"a HyperSlab selects {count} values, but its source has fewer; write it again", path=self._path
            )
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
            raise self._refused(f"the function {text!r} of items with several numbers per element is not read")
        return np.stack(columns, axis=1)


def _kind(item: Element) -> str:
    return item.get("ItemType", item.get("Type", "Uniform")).lower()


def _form(item: Element) -> str:
    return item.get("Format", "XML").upper()


def _number_type(item: Element) -> str:
    return item.get("NumberType", item.get("DataType", "Float")).upper()


def _declared_type(item: Element) -> np.dtype[Any]:
    """Return the type of numbers that an item of XML or of a binary file declares; an exception if there is none."""
    number = _number_type(item)
    return np.dtype(f"{_KINDS[number]}{int(item.get('Precision', _SIZES.get(number, 4)))}")


def _parsed(words: Sequence[str], item: Element) -> NDArray[Any]:
    """Return the numbers of a text; exact integers if integers are declared and the text has no others."""
    kind = _KINDS.get(_number_type(item), "f")
    if kind != "f":
        with contextlib.suppress(ValueError, OverflowError):
            return np.array(words, np.int64 if kind == "i" else np.uint64)
    return np.array(words, np.float64)


def _selection(start: Sequence[int], stride: Sequence[int], count: Sequence[int]) -> Selection:
    """Return slices that end just after the last selected value, so that `stop` is the least size of the whole."""
    if min(*start, *count, 0) < 0 or min(stride) < 1:
        raise ValueError("a part of an array begins before the array")
    return tuple(
        slice(first, first + step * (number - 1) + 1 if number else first, step)
        for first, step, number in zip(start, stride, count, strict=True)
    )
