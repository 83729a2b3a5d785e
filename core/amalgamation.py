"""Write the decoder with its C interface as two files, ``pdeanim.h`` and ``pdeanim.cpp``: `make amalgamation`.

    python -m core.amalgamation FOLDER

Another program adds these two files and compiles them with its own: ``c++ -std=c++20 -O2 -c pdeanim.cpp``. The text of
the sources stands in ``pdeanim.cpp`` in the order in which they include each other, without comments: those are in the
sources. A name that several sources declare for themselves is followed by the name of the source.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

CORE = Path(__file__).resolve().parent
INTERFACE = CORE / "bindings/c/include/pdeanim.h"

LEFT_OUT = {"bindings", "encode", "simulate", "tests", "text"}
"""Folders of the core that a decoder does not need; CMakeLists.txt leaves out the same."""

SYSTEM_HEADER = re.compile(r"\s*#\s*include\s*(<.*>)")
OWN_HEADER = re.compile(r'\s*#\s*include\s*"(.*)"')

TOKEN = re.compile(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'', re.DOTALL)
"""A comment, or a literal of a string or character, in which no comment begins."""

WORD = re.compile(r"\w+")

TYPE = re.compile(r"(?:struct|class|enum class|enum|using) (?!namespace)(\w+)")
"""The declaration of a type."""

NAME = re.compile(r"(\w+(?:<[^()]*?>)?::)*~?(\w+)(?:\[\w*\])*$")
"""The text before the parameters of a function or the value of a variable: the class of a member, and the name."""

HEAD = """\
// libpdeanim {version}: the decoder of .pdeanim files with its C interface, in one file.
//
// Made by core/amalgamation.py from the sources of pdecodec, where the comments are. Compile it as C++20 and link the
// system's threads: c++ -std=c++20 -O2 -c pdeanim.cpp
//
{licence}
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wpsabi"
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
#if defined(_MSC_VER) && !defined(NOMINMAX)
#define NOMINMAX
#endif
#ifndef PDEANIM_STATIC
#define PDEANIM_STATIC
#endif
"""


def without_comments(text: str) -> str:
    """Remove comments, and the empty lines and spaces that remain."""
    text = TOKEN.sub(lambda found: "" if found[0].startswith("/") else found[0], text)
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines() if line.strip())


@dataclass
class Item:
    """A declaration or definition of a namespace, a line of the preprocessor, or the brace of a namespace."""

    text: str
    names: frozenset[str]
    """Names that it declares, or the class of the member that it defines."""

    @cached_property
    def words(self) -> frozenset[str]:
        return frozenset(WORD.findall(self.text))


def items_of(text: str) -> Iterator[Item]:
    """Divide text without comments into the items of its namespaces."""
    lines, depth = list[str](), 0
    for line in text.splitlines(keepends=True):
        lines.append(line)
        bare = TOKEN.sub("", line)
        if not line.startswith("namespace"):
            depth += bare.count("{") - bare.count("}")
        if depth <= 0 and (line.startswith(("#", "//", "namespace", "}", "\n")) or bare.rstrip().endswith((";", "}"))):
            yield Item("".join(lines), declared_names("".join(lines)))
            lines, depth = [], 0
    assert not lines


def declared_names(text: str) -> frozenset[str]:
    """Return the names that an item declares, or the class of the member that it defines.

    Empty for items of the C interface, which no other item needs.
    """
    while text.startswith("template <"):
        end, depth = len("template <"), 1
        while depth:
            depth += {"<": 1, ">": -1}.get(text[end], 0)
            end += 1
        text = text[end:].lstrip()
    text = " ".join(text.split())
    if found := re.match(r"enum (?!class)(\w+)(?: : \w+)? {(.*)}", text):
        return frozenset([found[1], *re.findall(r"(\w+)(?: = \w+)?(?:,|$)", found[2])])
    if found := TYPE.match(text):
        return frozenset([found[1]])
    head, *rest = re.split(r"( = |[({;=]| : )", text, maxsplit=1)
    if not head[:1].isalpha() or head.split()[0] in {"namespace", "extern", "using", "template", "static_assert"}:
        return frozenset()
    found = NAME.search(head.rstrip())
    if found is None or found[2].startswith("pdeanim_"):
        return frozenset()
    if found[1]:
        return frozenset([re.sub(r"<.*|::", "", found[1])])
    return frozenset([found[2], *(re.findall(r", (\w+) = ", rest[1]) if rest[0] == " = " else [])])


def own_names(text: str) -> set[str]:
    """Return the names that a source declares in unnamed namespaces."""
    names = set[str]()
    for block in re.findall(r"^namespace {\n(.*?)^}  // namespace$", text, re.DOTALL | re.MULTILINE):
        for item in items_of(without_comments(block)):
            names |= item.names
    return names


def sources() -> list[Path]:
    """Return the sources of the decoder and of its C interface, sorted."""
    found = (path for path in CORE.rglob("*.cpp") if not LEFT_OUT & {*path.relative_to(CORE).parts})
    return [*sorted(found), *sorted((CORE / "bindings/c").glob("*.cpp"))]


def without_unused(text: str) -> str:
    """Remove items that only encoders need: repeatedly remove items that no other item names."""
    for_encoder = re.compile(r"template (?!<).*Mode::(encode|measure)", re.DOTALL)
    kept = [item for item in items_of(text) if not for_encoder.match(item.text)]
    items = list[Item]()
    while len(kept) != len(items):
        items = kept
        mentions = Counter(word for item in items for word in item.words - item.names)
        kept = [item for item in items if not item.names or any(mentions[name] for name in item.names)]
    return "".join(item.text for item in items)


class Amalgamation:
    """Text of the sources, each header once, where it is first included."""

    def __init__(self) -> None:
        self.system_headers = set[str]()
        self.parts = list[str]()
        self._included = {INTERFACE.name}
        texts = {path: path.read_text(encoding="utf-8") for path in sources()}
        all_texts = [path.read_text(encoding="utf-8") for path in CORE.rglob("*.?pp")]
        files = Counter(word for text in all_texts for word in {*WORD.findall(text)})
        for path, text in texts.items():
            for name in sorted(own_names(text)):
                if files[name] > 1:
                    own = rf"(?<![.:/\w])(?<!->){name}\b(?!\.hpp)"
                    text = re.sub(own, f"{name}_in_{path.parent.name}_{path.stem}", text)
            self._add(path.relative_to(CORE).as_posix(), text)

    def _add(self, name: str, text: str) -> None:
        kept = list[str]()
        for line in text.splitlines():
            if found := OWN_HEADER.match(line):
                self._include(found[1])
            elif (found := SYSTEM_HEADER.match(line)) and not self._is_conditional(kept):
                self.system_headers.add(found[1])
            elif line != "#pragma once":
                kept.append(line)
        self.parts.append(f"\n// {name}\n" + without_comments("\n".join(kept)))

    def _include(self, name: str) -> None:
        if name not in self._included:
            self._included.add(name)
            self._add(name, (CORE / name).read_text(encoding="utf-8"))

    @staticmethod
    def _is_conditional(before: list[str]) -> bool:
        """Return whether the text after some lines is within an ``#if``."""
        opened = [line.split("if", 1)[0] for line in before if re.match(r"#\s*(if|endif)", line)]
        return opened.count("#") > opened.count("#end")


def write(folder: Path) -> None:
    """Write both files to a folder, which is made if it is missing."""
    version = re.search(r"VERSION ([\d.]+)", (CORE / "CMakeLists.txt").read_text(encoding="utf-8").split("project(")[1])
    assert version is not None
    licence = (CORE.parent / "LICENSE").read_text(encoding="utf-8").splitlines()
    whole = Amalgamation()
    head = HEAD.format(version=version[1], licence="".join(f"// {line}".rstrip() + "\n" for line in licence))
    headers = "".join(f"#include {name}\n" for name in sorted(whole.system_headers))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / INTERFACE.name).write_text(INTERFACE.read_text(encoding="utf-8"), encoding="utf-8")
    text = f'{head}\n#include "{INTERFACE.name}"\n\n{headers}' + without_unused("".join(whole.parts))
    (folder / "pdeanim.cpp").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
