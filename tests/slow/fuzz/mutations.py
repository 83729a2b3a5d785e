"""Changes to files that respect how their format is structured.

They change numbers in text, fields of binary files, values of JSON, members of archives and datasets of HDF5. A
third of the time they change bytes as if nothing were known about the format.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

Mutation = Callable[[random.Random, bytes], bytes]

INTEGERS = (-1, 0, 1, 2, 3, 7, 127, 255, 256, 65535, 2**31 - 1, 2**31, -(2**31), 2**32 - 1, 2**32, 2**53, 2**63, 10**30)
REALS = (0.0, -0.0, 1e-45, 1e38, -1e38, 1e300, float("nan"), float("inf"), float("-inf"), 0.5)
WORDS = (b"", b"nan", b"-inf", b"1e999", b"-", b"/", b"//", b"1/", b"0x10", b"1_000", b"\xff", b"\0", b"1.5", b"#")


def of_bytes(random_: random.Random, data: bytes) -> bytes:
    """Change, cut, repeat or move bytes, without understanding the file."""
    changed = bytearray(data or b"\0")
    for _ in range(random_.randint(1, 4)):
        changed = changed or bytearray(1)
        at = random_.randrange(len(changed))
        count = min(random_.randint(1, 16), len(changed) - at)
        kind = random_.randrange(6)
        if kind == 0:
            changed[at] = random_.randrange(256)
        elif kind == 1:
            changed[at] ^= 1 << random_.randrange(8)
        elif kind == 2:
            changed[at : at + count] = random_.choice((b"\0", b"\xff", b"\x7f")) * count
        elif kind == 3:
            start = random_.randrange(len(changed))
            changed[at:at] = changed[start : start + random_.randint(1, 64)]
        elif kind == 4:
            del changed[at : at + count]
        else:
            del changed[at + 1 :]
    return bytes(changed)


def of_fields(random_: random.Random, data: bytes) -> bytes:
    """Replace fields of four or eight bytes, mostly among the first two hundred bytes, by critical numbers."""
    changed = bytearray(data.ljust(8, b"\0"))
    for _ in range(random_.randint(1, 3)):
        end = len(changed) - 4 if random_.random() < 0.3 else min(len(changed) - 4, 200)
        at = random_.randint(0, max(0, end))
        order = random_.choice("<>")
        if random_.random() < 0.6:
            size, code = random_.choice(((1, "B"), (2, "H"), (4, "I"), (4, "I"), (8, "Q")))
            field = struct.pack(order + code, random_.choice(INTEGERS) % 256**size)
        else:
            with np.errstate(over="ignore"):
                field = np.array(random_.choice(REALS)).astype(f"{order}f{random_.choice((4, 4, 8))}").tobytes()
        changed[at : at + len(field)] = field
    return bytes(changed)


def of_text(random_: random.Random, data: bytes) -> bytes:
    """Replace words, and remove, repeat, join or move lines."""
    lines = data.split(b"\n")
    for _ in range(random_.randint(1, 4)):
        at = random_.randrange(len(lines))
        kind = random_.randrange(8)
        if kind < 4:
            words = re.split(rb"(\s+)", lines[at])
            place = random_.randrange(len(words))
            words[place] = _word(random_, words[place])
            lines[at] = b"".join(words)
        elif kind == 4:
            del lines[at : at + random_.randint(1, 3)]
        elif kind == 5:
            lines[at:at] = lines[at : at + 3] * random_.choice((1, 2, 50))
        elif kind == 6:
            lines.insert(random_.randrange(len(lines)), lines[at])
        else:
            lines[at] += random_.choice((b" ", b"\\", b"", b"\r", b" 1 2 3")) + lines.pop(at - 1)
        lines = lines or [b""]
    return b"\n".join(lines)


def _word(random_: random.Random, word: bytes) -> bytes:
    kind = random_.randrange(4)
    if kind == 0:
        return random_.choice(WORDS)
    if kind == 1:
        return str(random_.choice(INTEGERS + REALS)).encode()
    if kind == 2:
        return of_bytes(random_, word)
    return re.sub(rb"\d+", lambda _: str(random_.choice(INTEGERS)).encode(), word, count=1)


def of_json(random_: random.Random, data: bytes) -> bytes:
    """Replace, remove or repeat values at any depth."""
    tree = json.loads(data)
    for _ in range(random_.randint(1, 3)):
        places = [*_places(tree)]
        if not places:
            break
        holder, key = random_.choice(places)
        kind = random_.randrange(6)
        if kind == 0:
            del holder[key]
        elif kind == 1 and isinstance(holder, list):
            holder.extend([holder[key]] * random_.choice((1, 2, 40)))
        elif kind == 2:
            other, name = random_.choice(places)
            holder[key] = json.loads(json.dumps(other[name]))
        elif kind == 3 and isinstance(holder[key], int):
            holder[key] = random_.choice([len(places), holder[key] + 1, holder[key] - 1, -holder[key], 5120, 5126])
        else:
            holder[key] = _json_value(random_)
    return json.dumps(tree).encode()


def _places(tree: Any) -> list[tuple[Any, Any]]:
    found = []
    keys = list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    for key in keys:
        found += [(tree, key), *_places(tree[key])]
    return found


def _json_value(random_: random.Random) -> Any:
    return random_.choice(
        [
            *INTEGERS,
            *REALS,
            None,
            True,
            "",
            "x",
            "../x",
            "data:,",
            "VEC3",
            "SCALAR",
            [],
            {},
            [0] * 5,
            {"a": 1},
            "\ud800",
        ]
    )


def of_glb(random_: random.Random, data: bytes) -> bytes:
    """Change the JSON or the buffer of a GLB, and put the file together again, mostly with correct lengths."""
    (length,) = struct.unpack_from("<I", data, 12)
    text, rest = data[20 : 20 + length], data[20 + length :]
    if random_.random() < 0.7:
        text = of_json(random_, text)
        text += b" " * (-len(text) % 4)
    else:
        rest = rest[:8] + of_fields(random_, rest[8:])
    whole = struct.pack("<III", 0x46546C67, 2, 20 + len(text) + len(rest)) + struct.pack("<I", len(text))
    whole += b"JSON" + text + rest
    return of_fields(random_, whole[:32]) + whole[32:] if random_.random() < 0.1 else whole


def of_ply(random_: random.Random, data: bytes) -> bytes:
    """Change the header as text, and the body as binary fields, or as text if it is text."""
    head, mark, body = data.partition(b"end_header\n")
    if random_.random() < 0.6:
        return of_text(random_, head) + mark + body
    return head + mark + (of_text if b"ascii" in head else of_fields)(random_, body)


def of_npz(random_: random.Random, data: bytes) -> bytes:
    """Give members other shapes, types or numbers; remove, rename or compress them."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    whole = dict(members)
    for _ in range(random_.randint(1, 2)):
        name = random_.choice([*members])
        kind = random_.randrange(6)
        if kind == 0:
            del members[name]
        elif kind == 1:
            members[random_.choice([*members])] = members[name]
        elif kind == 2:
            members[name] = of_fields(random_, members[name])
        elif kind == 3:
            members[name] = of_text(random_, members[name][:128]) + members[name][128:]
        else:
            members[name] = _array(random_, whole[name])
        if not members:
            break
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", random_.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    packed = out.getvalue()
    return of_fields(random_, packed) if random_.random() < 0.15 else packed


def _array(random_: random.Random, member: bytes) -> bytes:
    """Replace an array by one of other types or shapes, or put critical numbers into it."""
    array = _other(random_, np.load(io.BytesIO(member), allow_pickle=False))
    out = io.BytesIO()
    np.save(out, array, allow_pickle=False)
    return out.getvalue()


def _other(random_: random.Random, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    kind = random_.randrange(6)
    numeric = array.dtype.kind in "fiub"
    if kind == 0:
        return array.reshape(-1)[: random_.randint(0, array.size)]
    if kind == 1:
        return array[None] if random_.random() < 0.5 else array.reshape(*array.shape, 1)
    if kind == 2:
        return np.zeros(
            [random_.choice((0, 1, 3, 5)) for _ in range(random_.randint(0, 4))], random_.choice("fdilbSUc")
        )
    if kind == 3 and numeric:
        with np.errstate(all="ignore"):
            return array.astype(random_.choice(("f2", "f8", "i1", "i8", "u4", "u8", "c8", ">f4", "?")))
    if kind == 4 and array.dtype.kind in "iu" and array.size:
        changed = array.astype(np.int64)
        low, high = -(2**63), 2**63 - 1
        changed.flat[random_.randrange(array.size)] = min(max(random_.choice(INTEGERS), low), high)
        return changed
    if array.dtype.kind == "f" and array.size:
        changed = array.copy()
        with np.errstate(all="ignore"):
            changed.flat[random_.randrange(array.size)] = random_.choice(REALS)
        return changed
    return array[::-1] if array.ndim else array


def of_hdf5(random_: random.Random, data: bytes) -> bytes:
    """Give datasets other shapes, types or numbers, replace them by groups and links, remove them, or change
    attributes.
    """
    held = io.BytesIO(data)
    with h5py.File(held, "r+") as file:
        for _ in range(random_.randint(1, 2)):
            names: list[str] = []
            file.visit(names.append)
            if not names:
                break
            name = random_.choice(names)
            kind = random_.randrange(7)
            item = file.get(name)
            if kind == 0:
                del file[name]
            elif kind == 1 and file.attrs:
                key = random_.choice([*file.attrs])
                value = random_.choice([-1, 0.0, float("nan"), 1e300, "x", np.zeros(3), 2**62, -(2**31)])
                file.attrs[key] = value
            elif kind == 2:
                del file[name]
                link = random_.choice(("soft", "external", "cycle", "group"))
                if link == "group":
                    file.create_group(name)
                else:
                    file[name] = (
                        h5py.ExternalLink("/etc/passwd", "/x") if link == "external" else h5py.SoftLink(f"/{name}")
                    )
            elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiubSU":
                changed = _other(random_, item[()] if item.shape else np.array(item[()]))
                del file[name]
                if changed.dtype.kind != "U":
                    file[name] = changed
    changed_bytes = held.getvalue()
    return of_fields(random_, changed_bytes) if random_.random() < 0.1 else changed_bytes


def mixed(*mutations: Mutation) -> Mutation:
    """Return a function that applies one of several mutations, or :func:`of_bytes` if the chosen one cannot
    handle the file.
    """

    def mutate(random_: random.Random, data: bytes) -> bytes:
        if random_.random() < 2 / 3:
            try:
                return random_.choice(mutations)(random_, data)
            except (ValueError, KeyError, IndexError, OSError, RuntimeError, TypeError, zlib.error, OverflowError):
                pass
        return of_bytes(random_, data)

    return mutate
