"""Parse the XML of an XDMF file, and resolve its includes (XInclude) and references (``Reference``).

Both name elements by XPath. The subset that XDMF files use is supported: steps by name, ``*``, ``.`` and ``//``,
with predicates of a position, of attributes and of ``self::NAME``, joined by ``and`` and ``or``. Anything else is
refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from pdecodec.errors import InputError, damaged
from pdecodec.system.reading import FileScope

Element = ElementTree.Element

_Predicate = Callable[[Element, int, int], bool]
"""Tells whether to select an element, given its position from 1 and the number of elements."""

MAX_DOCUMENTS = 10_000
"""Largest number of files in a document: the XDMF file and those it includes."""

_INCLUDE = re.compile(r"\{https?://www\.w3\.org/\d{4}/XInclude\}include")
_XPOINTER = re.compile(r"xpointer\((?P<path>.*)\)", re.DOTALL)
_CHILDREN = re.compile(r"element\((?P<numbers>(/\d+)+)\)")
_STEP = re.compile(r"(?:child::)?(?P<test>[\w.-]+|\*)(?P<predicates>(?:\[.*\])*)", re.DOTALL)
_POSITION = re.compile(r"(?:position\(\)\s*=\s*)?(?P<number>\d+|last\(\))")
_ATTRIBUTE = re.compile(r"@(?P<name>[\w:.-]+)(?:\s*=\s*(?P<quote>[\"'])(?P<value>.*)(?P=quote))?", re.DOTALL)
_SELF = re.compile(r"self::(?P<name>[\w.-]+|\*)")


class Document:
    """An XDMF document with its includes replaced by the included elements.

    Attributes
    ----------
    path : pathlib.Path
    scope : FileScope
        Folder of the files that it may name.
    root : xml.etree.ElementTree.Element
        An element that is included several times is shared between its places.

    Raises
    ------
    InputError
        If it is no XML, or includes a missing element or itself.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.scope = path, FileScope(path)
        self._roots: dict[Path, Element] = {}
        self._homes: dict[Element, tuple[Path, Element]] = {}
        self._found: dict[tuple[Element, str], list[Element]] = {}
        self._parents: dict[Element, dict[str, list[Element]]] = {}
        self.root = self._parse(path.name, path.parent)
        self._include()
        self._check_acyclic()

    def folder(self, element: Element) -> Path:
        """Return the folder of the file that an element comes from; file names in it are relative to that folder."""
        return self._homes[element][0]

    def resolved(self, element: Element) -> Element:
        """Return the element that an element refers to, or the element itself if it is not a reference.

        Raises
        ------
        InputError
            If it refers to nothing, to several elements, to an element with another tag, or to itself.
        """
        seen = {element}
        while "Reference" in element.attrib:
            reference = element.attrib["Reference"].strip()
            path = (element.text or "").strip() if reference.upper() == "XML" else reference
            found = self._find(path, self._homes[element][1])
            if len(found) != 1 or found[0].tag != element.tag or found[0] in seen:
                raise damaged(
                    f"a {element.tag} refers to {path!r}, which is {len(found)} elements, or none of its kind; "
                    "write it again",
                    path=self.path,
                )
            element = found[0]
            seen.add(element)
        return element

    def children(self, element: Element, tag: str) -> list[Element]:
        """Return the children with a tag, references resolved."""
        return [self.resolved(child) for child in element if child.tag == tag]

    def child(self, element: Element, tag: str) -> Element | None:
        """Return the only child with a tag, None if there is none; InputError if there are several."""
        found = self.children(element, tag)
        if len(found) > 1:
            name = element.get("Name", "")
            raise InputError(
                f"{element.tag} {name!r} has {len(found)} elements {tag}; it may have only one",
                code="damaged-input",
                path=self.path,
            )
        return found[0] if found else None

    def _parse(self, name: str, folder: Path) -> Element:
        path = self.scope.checked(name, folder)
        key = path.resolve()
        if key not in self._roots:
            if len(self._roots) >= MAX_DOCUMENTS:
                raise InputError(f"includes more than {MAX_DOCUMENTS:,} files", code="too-large", path=self.path)
            with self.scope.open(name, folder) as file:
                try:
                    self._roots[key] = ElementTree.parse(file).getroot()
                except (ElementTree.ParseError, OSError, ValueError) as error:
                    raise damaged(f"is not an XDMF file, or is damaged ({error}); write it again", path=path) from error
            self._homes.update(dict.fromkeys(self._roots[key].iter(), (path.parent, self._roots[key])))
        return self._roots[key]

    def _include(self) -> None:
        """Replace includes by the elements they name; all are found before the first is replaced."""
        parents: list[Element] = []
        targets: dict[Element, list[Element]] = {}
        done: set[Path] = set()
        while len(done) < len(self._roots):
            for key, root in list(self._roots.items()):
                if key in done:
                    continue
                done.add(key)
                for parent in root.iter():
                    for child in parent:
                        if _INCLUDE.fullmatch(str(child.tag)):
                            targets[child] = self._included(child, root)
                            parents.append(parent)
        self._found.clear()
        self._parents.clear()
        for parent in dict.fromkeys(parents):
            parent[:] = [found for child in parent for found in self._expand_include(child, targets, ())]

    def _included(self, include: Element, root: Element) -> list[Element]:
        """Return the elements that an XInclude element names."""
        name, pointer = include.get("href", ""), include.get("xpointer", "").strip()
        if include.get("parse", "xml") != "xml" or (not name and not pointer) or "://" in name:
            raise damaged(f"includes {name or 'text'!r}, which is not an XDMF file next to it", path=self.path)
        if name:
            root = self._parse(name, self.folder(include))
        if not pointer:
            return [root]
        xpointer, numbers = _XPOINTER.fullmatch(pointer), _CHILDREN.fullmatch(pointer)
        found: list[Element] = []
        if xpointer is not None:
            found = self._find(xpointer["path"], root)
        elif numbers is not None:
            found = _numbered(root, [int(part) for part in numbers["numbers"].split("/")[1:]])
        else:
            raise InputError(
                f"the pointer {pointer!r} of an include is not understood", code="unsupported-feature", path=self.path
            )
        if not found:
            raise damaged(f"includes {pointer!r}, which does not exist; write it again", path=self.path)
        return found

    def _expand_include(
        self, child: Element, targets: dict[Element, list[Element]], above: tuple[Element, ...]
    ) -> Iterator[Element]:
        if child in above:
            raise damaged("includes itself; write it again", path=self.path)
        if child not in targets:
            yield child
            return
        for found in targets[child]:
            yield from self._expand_include(found, targets, (*above, child))

    def _check_acyclic(self) -> None:
        """Raise InputError if an element contains itself."""
        above: set[Element] = set()
        done: set[Element] = set()
        left: list[tuple[Element, bool]] = [(self.root, False)]
        while left:
            element, is_left = left.pop()
            if is_left:
                above.discard(element)
                done.add(element)
            elif element in above:
                raise damaged("includes itself; write it again", path=self.path)
            elif element not in done:
                above.add(element)
                left.append((element, True))
                left += [(child, False) for child in element]

    def _find(self, path: str, root: Element) -> list[Element]:
        """Return the elements at an XPath that begins at the root."""
        if (root, path) not in self._found:
            if root not in self._parents:
                self._parents[root] = _parents_by_tag(root)
            try:
                self._found[root, path] = _select(path, self._parents[root])
            except ValueError as error:
                raise InputError(
                    f"the XPath {path!r} is not understood ({error})", code="unsupported-feature", path=self.path
                ) from error
        return self._found[root, path]


def _parents_by_tag(root: Element) -> dict[str, list[Element]]:
    """Return the elements that have children of each tag, in document order; the first is a parent of the root."""
    above = Element("document")
    above.append(root)
    parents: dict[str, dict[Element, None]] = {"*": {}}
    for parent in above.iter():
        for child in parent:
            parents["*"][parent] = None
            parents.setdefault(_name(child), {})[parent] = None
    return {tag: list(found) for tag, found in parents.items()}


def _numbered(root: Element, numbers: Sequence[int]) -> list[Element]:
    """Return the element at a sequence of child numbers; the first number is that of the root."""
    if numbers[0] != 1:
        return []
    for number in numbers[1:]:
        if not 1 <= number <= len(root):
            return []
        root = root[number - 1]
    return [root]


def _select(path: str, parents: Mapping[str, list[Element]]) -> list[Element]:
    """Return the elements at a path; `parents` come from :func:`_parents_by_tag`."""
    text = path.strip()
    if not text.startswith("/"):
        raise ValueError("it does not begin at the root")
    above = parents["*"][0]
    nodes, is_deep = [above], False
    for step in _split(text[1:], "/"):
        if step == "":
            is_deep = True
            continue
        found = _STEP.fullmatch(step)
        if found is None and step != ".":
            raise ValueError(f"step {step!r}")
        test = "*" if found is None else found["test"]
        if is_deep and nodes == [above]:
            nodes = parents.get(test, [])
        elif is_deep:
            nodes = list(dict.fromkeys(below for node in nodes for below in node.iter()))
        is_deep = False
        if found is None:
            continue
        predicates = [_predicate(part[:-1]) for part in _split(found["predicates"], "[")[1:]]
        chosen: list[Element] = []
        for node in nodes:
            here = [child for child in node if test in ("*", _name(child))]
            for holds in predicates:
                here = [one for at, one in enumerate(here, 1) if holds(one, at, len(here))]
            chosen += here
        nodes = list(dict.fromkeys(chosen))
    return nodes


def _name(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _predicate(predicate: str) -> _Predicate:
    """Return a function that tests a predicate."""
    for joiner, combined in ((" or ", any), (" and ", all)):
        parts = _split(predicate, joiner)
        if len(parts) > 1:
            return _combined(combined, [_predicate(part) for part in parts])
    text = predicate.strip()
    position, attribute, itself = (pattern.fullmatch(text) for pattern in (_POSITION, _ATTRIBUTE, _SELF))
    if position is not None and position["number"] == "last()":
        return lambda one, at, count: at == count
    if position is not None:
        number = int(position["number"])
        return lambda one, at, count: at == number
    if attribute is not None:
        name, value = attribute["name"], attribute["value"]
        if attribute["quote"] is None:
            return lambda one, at, count: name in one.attrib
        return lambda one, at, count: one.get(name) == value
    if itself is not None:
        wanted = itself["name"]
        return lambda one, at, count: wanted in ("*", _name(one))
    raise ValueError(f"predicate {text!r}")


def _combined(how: Callable[[Iterable[bool]], bool], parts: Sequence[_Predicate]) -> _Predicate:
    """Return a predicate that holds if any or all of several predicates hold."""
    return lambda one, at, count: how(part(one, at, count) for part in parts)


def _split(text: str, at: str) -> list[str]:
    """Split a text at separators that are not quoted and, except for ``[``, not in brackets."""
    parts, depth, quote, start, place = [], 0, "", 0, 0
    while place < len(text):
        letter = text[place]
        if not quote and (depth == 0) and text.startswith(at, place):
            parts.append(text[start:place])
            start = place + len(at)
            if at != "[":
                place = start
                continue
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        else:
            depth += (letter == "[") - (letter == "]")
        place += 1
    return [*parts, text[start:]]
