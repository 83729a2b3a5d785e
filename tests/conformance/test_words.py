"""Phrases that readers stumble over, kept out of the folders whose texts are clean."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

CLEAN = (
    *(
        "batch",
        "cli",
        "core",
        "docs",
        "examples",
        "formats",
        "pdecodec",
        "player",
        "report",
        "research",
        "spec",
        "tests",
    ),
    *("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"),
)
"""Folders and files without the phrases."""

UNCHECKED = ("tests/conformance/test_words.py",)
"""The phrases themselves."""

TEXTS, SOURCES = ("py", "pyi", "md"), ("c", "cpp", "h", "hpp", "js", "mjs", "ts", "html")
"""Extensions of files that are checked as a whole, and of those of which only the comments are checked."""

COMMENT = re.compile(r"(?:(?<![:\"'])//[^\n]*\n\s*)+|/\*.*?\*/|<!--.*?-->", re.DOTALL)
"""A comment of C++, JavaScript or HTML; ``//`` on consecutive lines is one comment."""

PHRASES = {
    r"beside(?!-)": "say next to, besides, or compared with",
    r"(no|some)body": "name who does it, or use the passive",
    r"what is left": "name it: the remaining frames, bytes, time",
    r"where (it is|there is|there are) (none|no)": "a condition takes 'if'; 'where' is for places",
    r"where nothing is said|where it does not say": "say 'by default' or 'if IN does not state it'",
    r"those of every": "repeat the noun",
    r"from afar": "say over the network",
    r"is (said|told)": "say prints, or a note tells",
    r"put aside": "say cached or kept",
    r"aloud": "say with a note",
    r"goes on where it was": "say resumes where it stopped",
}
"""Regular expressions of whole words, and what to write instead."""


def found_phrases(text: str) -> list[str]:
    """Return each phrase in a text with its advice; line breaks within phrases do not hide them."""
    plain = re.sub(r"\s+(?:#\s|//+\s|\*\s|\"f?\"?)?\s*", " ", text)
    hits = [(re.search(rf"\b({phrase})\b", plain, re.IGNORECASE), advice) for phrase, advice in PHRASES.items()]
    return [f"{hit[0]!r}: {advice}" for hit, advice in hits if hit is not None]


def comments_of(source: str) -> str:
    """Return the comments of C++, JavaScript or HTML without names in backticks; no phrase spans two comments."""
    return "\n;\n".join(re.sub("`[^`\n]*`", "`", found[0]) for found in COMMENT.finditer(source))


@pytest.mark.parametrize("place", CLEAN)
def test_clean_texts_use_plain_phrases(place: str) -> None:
    suffixes = (*TEXTS, *SOURCES)
    files = [file for suffix in suffixes for file in (ROOT / place).rglob(f"*.{suffix}")] or [ROOT / place]
    names = {file.relative_to(ROOT).as_posix(): file for file in files if "node_modules" not in file.parts}
    texts = {name: file.read_text(encoding="utf-8") for name, file in names.items() if not name.startswith(UNCHECKED)}
    texts = {name: comments_of(text) if name.endswith(SOURCES) else text for name, text in texts.items()}
    found = {name: found_phrases(text) for name, text in texts.items()}
    assert {name: hits for name, hits in found.items() if hits} == {}


def test_a_phrase_is_found_across_lines() -> None:
    assert found_phrases("# Words that\n# nobody reads") == ["'nobody': name who does it, or use the passive"]
    assert found_phrases("It is what is\n    left of it.") == [
        "'what is left': name it: the remaining frames, bytes, time"
    ]


def test_only_comments_of_sources_are_checked() -> None:
    source = (
        'beside(1); // Words that\n  // nobody reads\nlog("https://nobody.org"); /* from\n * afar */ // is\nsaid();\n'
    )
    assert found_phrases(comments_of(source)) == [
        "'nobody': name who does it, or use the passive",
        "'from afar': say over the network",
    ]
