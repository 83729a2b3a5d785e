"""Record data that change from frame to frame in files of one frame each, and name data that are not kept."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator

from pdecodec.formats.base.frame_looks import is_same_attribute
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import Attribute, Content, MeshObject, MeshSequence


class NotKept(str):
    """A notice about data of a file that are not kept; the inventory lists their `names` as dropped."""

    __slots__ = ("names",)
    names: tuple[str, ...]


def is_about_loss(notice: str) -> bool:
    """Return whether a notice names data that is not kept."""
    return isinstance(notice, NotKept)


def not_kept(names: Iterable[str], line: str = "not kept: {}") -> tuple[str, ...]:
    """Return a notice about data of a file that are not kept; empty if there are no names."""
    found = tuple(dict.fromkeys(names))
    if not found:
        return ()
    told = NotKept(line.format(", ".join(found)))
    told.names = found
    return (told,)


_KINDS = {
    "color": "colours",
    "uv": "UVs",
    "normal_group": "hard edges",
    "group": "groups",
    "material": "materials",
    "smoothing": "smoothing groups",
}
"""Words for the roles of attributes."""


def kind_of(data: Attribute | Field) -> str:
    """Return the words for the role, domain and name of data: "vertex colours", "UVs 'map2'", "face area"."""
    role, _, name = data.name.partition(":")
    if role not in _KINDS and isinstance(data, Field):
        return data.name if data.domain == "vertex" else f"{data.domain} {data.name}"
    if role not in _KINDS:
        return f"attribute {data.name!r}"
    domain = f"{data.domain} " if role == "color" else ""
    return f"{domain}{_KINDS[role]}{f' {name!r}' if name and name != data.domain else ''}"


class FrameChanges:
    """Differences of frames from the first frame of their run, and all notices about their files."""

    def __init__(self) -> None:
        self._frames: dict[str, int] = {}
        self._absent: set[str] = set()
        self._notices: dict[str, str] = {}

    def note(self, frame: int, kind: str, *, is_in_first: bool) -> None:
        """Note the first frame in which data of a kind differ, and whether the run's first frame has such data."""
        if kind not in self._frames:
            self._frames[kind] = frame
            if not is_in_first:
                self._absent.add(kind)

    def note_lines(self, notices: Iterable[str]) -> None:
        """Note notices about a file; of notices that differ only in numbers, the first one is kept."""
        for notice in notices:
            self._notices.setdefault(re.sub(r"\d+", "#", notice), notice)

    def compare(
        self, frame: int, attributes: Iterable[Attribute], first: Iterable[Attribute], but: Collection[str] = ()
    ) -> None:
        """Compare the attributes of a frame with those of the first frame of its run; `but` names attributes to
        skip.
        """
        mine, others = ({kind_of(one): one for one in each if one.name not in but} for each in (first, attributes))
        for kind in {**mine, **others}.keys() - self._frames.keys():
            if not is_same_attribute(mine.get(kind), others.get(kind)):
                self.note(frame, kind, is_in_first=kind in mine)

    def notices(self, runs: int) -> tuple[str, ...]:
        """Return notices about the files, and about changes from frame to frame; `runs` is the number of runs."""
        kept = f"the values of the first frame{'' if runs < 2 else ' of each run'} are kept"
        changes = [
            f"{kind} are not in the first frame (first at frame {frame}): they are not kept"
            if kind in self._absent
            else f"{kind} change from frame to frame (first at frame {frame}): {kept}"
            for kind, frame in sorted(self._frames.items(), key=lambda item: (item[1], item[0]))
        ]
        return (*self._notices.values(), *changes)

    def contents(self, run: MeshSequence) -> tuple[Content, ...]:
        """List the content of files: data that a run of frames keeps, and data of any frame that are not kept."""
        lost = [name for line in self._notices.values() if isinstance(line, NotKept) for name in line.names]
        lost += sorted(self._absent)
        lost += [f"changes of {kind}" for kind in sorted(self._frames.keys() - self._absent)]
        return (
            *(one for item in run.objects for one in kept_of(item)),
            *(Content(f"/{kind}", kind, "coded") for kind in map(kind_of, run.fields)),
            *(Content(f"/{kind}", kind, "dropped") for kind in dict.fromkeys(lost)),
        )


def kept_of(item: MeshObject) -> Iterator[Content]:
    """List an object's positions, faces, lines and attributes; labels of attributes one by one."""
    faces, lines = item.connectivity.face_count, item.connectivity.line_count
    for kind in ["positions", *["faces"] * bool(faces), *["lines"] * bool(lines)]:
        yield Content(f"/{item.name}/{kind}", kind, "coded")
    for attribute in item.attributes:
        if attribute.name == "object":
            continue  # the reader lists the names of objects
        kind = kind_of(attribute)
        for label in attribute.labels or ("",):
            yield Content(f"/{item.name}/{kind}/{label}".rstrip("/"), kind, "coded")
