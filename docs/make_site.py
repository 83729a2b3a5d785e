"""Build the documentation as a site: `python docs/make_site.py build/site` (or `make site`).

Copies the Markdown files that `docs/site/pages.toml` lists to a folder, and adds the player on the first page and the
reference of Python. Sphinx makes the site from this folder; every warning is an error. Then all links of the site are
checked; broken ones are errors, and so are files that a page loads from other hosts.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = ROOT / "docs" / "site"
MENU: dict[str, list[str]] = tomllib.loads((SETTINGS / "pages.toml").read_text(encoding="utf-8"))
PAGES = ("README.md", *(page for pages in MENU.values() for page in pages))

REFERENCE = {
    "Encode": r"codec\.(encod|settings)",
    "Decode": r"codec\.(opening|decoder|array_evaluator|paper_form|source)",
    "Check, repair, cut and join": r"codec\.(checking|mending|salvaging|editing)",
    "Meshes and files": r"mesh\.|formats",
    "Errors": r"errors",
}
"""Pages of the reference, each with a pattern of the modules, below pdecodec, whose public names it has."""

SIMULATE = "simulate cloth -o a.npz --drape sphere --columns 60 --rows 60 --frames 72"
PLAYER = (
    '<iframe class="player" src="player.html" title="A clip in the player: drag to rotate" loading="lazy"></iframe>'
)

FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)
IMAGE = re.compile(r"!\[[^\]]*\]\([^)]+\)")
LINK = re.compile(r"(!?)\[([^\[\]]*)\]\(([^()\s#]+)(#[^()\s]*)?\)")


def staged(page: str) -> str:
    """Return where a file of the repository stands in the site; a folder's README is its index."""
    return re.sub(r"(^|/)README\.md$", r"\1index.md", page)


def repository() -> str | None:
    """Return the address of the repository: that of pyproject.toml, or of the hosted run; None if neither has one."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"].get("urls", {})
    hosted = (
        "{GITHUB_SERVER_URL}/{GITHUB_REPOSITORY}".format_map(os.environ) if "GITHUB_REPOSITORY" in os.environ else None
    )
    return urls.get("Repository", hosted)


class Stage:
    """The folder that Sphinx reads.

    Parameters
    ----------
    folder : Path
        Empty.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.repository = repository()

    def write(self, place: str, text: str) -> None:
        path = self.folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def page(self, page: str) -> str:
        """Return the text of a page with links that work on the site."""
        parts = FENCE.split((ROOT / page).read_text(encoding="utf-8"))
        parts[::2] = [LINK.sub(lambda link: self._link(page, link), part) for part in parts[::2]]
        return "".join(parts)

    def _link(self, page: str, link: re.Match[str]) -> str:
        """Return a link to another page, to the repository, or to a copy of the file in the site."""
        image, text, target, anchor = link.groups(default="")
        if urlsplit(target).scheme:
            return link[0]
        path = (ROOT / page).parent.joinpath(target).resolve()
        name = path.relative_to(ROOT).as_posix()
        if path.is_dir() and f"{name}/README.md" in PAGES:
            name += "/README.md"
        if not path.exists():
            raise SystemExit(f"{page}: the link to {target} leads to nothing")
        if name not in PAGES and not image and self.repository:
            return f"[{text}]({self.repository}/{'tree' if path.is_dir() else 'blob'}/main/{name}{anchor})"
        if path.is_dir() and name not in PAGES:
            return text
        if name not in PAGES:
            (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, self.folder / name)
        return f"{image}[{text}]({os.path.relpath(staged(name), Path(staged(page)).parent)}{anchor})"


def menu(caption: str, pages: list[str]) -> str:
    return "\n".join(["", "```{toctree}", ":hidden:", f":caption: {caption}", "", *pages, "```", ""])


def reference_pages() -> dict[str, str]:
    """Return the pages of the reference of Python by name: all public names with their docstrings."""
    import pdecodec

    pages = dict.fromkeys(REFERENCE, "")
    names = [name for name in pdecodec.__all__ if name != "__version__"]
    for name in sorted(names, key=lambda name: (isinstance(getattr(pdecodec, name), type), name)):
        kind = "autoclass" if isinstance(getattr(pdecodec, name), type) else "autofunction"
        module = getattr(pdecodec, name).__module__.removeprefix("pdecodec.")
        [page] = [page for page, modules in REFERENCE.items() if re.match(modules, module)]
        members = "   :members:\n   :show-inheritance:\n" if kind == "autoclass" else ""
        pages[page] += f"\n## `{name}`\n\n```{{eval-rst}}\n.. {kind}:: pdecodec.{name}\n{members}```\n"
    return {
        f"reference/{page.split(',')[0].lower().replace(' ', '-')}": f"# {page}\n{text}" for page, text in pages.items()
    }


def make_player(page: Path) -> None:
    """Write the viewer's page of a clip that is simulated and encoded now."""
    from pdecodec.cli.main import run

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for command in (SIMULATE, "encode a.npz -o cloth.pdeanim", "view cloth.pdeanim -o a.html"):
            if run(command.split()) != 0:
                raise SystemExit(f"pdecodec {command} failed")
        text = Path("a.html").read_text(encoding="utf-8")
    style = (SETTINGS / "player.css").read_text(encoding="utf-8")
    page.write_text(text.replace("</style>", f"{style}</style>", 1), encoding="utf-8")


class Links(HTMLParser):
    """Links, anchors and loaded files of a page."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id":
                self.anchors.add(value or "")
            elif name in ("href", "src"):
                (self.links if tag == "a" else self.loaded).append(value or "")


def broken_links(site: Path) -> list[str]:
    """Return what is wrong with the links of a site: files and anchors that are not there, files of other hosts."""
    pages = {path: Links(path) for path in site.rglob("*.html")}
    wrong = []
    for path, page in pages.items():
        for link in [*page.links, *page.loaded]:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                wrong += [f"loads {link}"] if link in page.loaded and parts.scheme != "data" else []
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_file():
                wrong.append(f"{path.relative_to(site)}: {link} leads to nothing")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                wrong.append(f"{path.relative_to(site)}: {link} has no such place")
    wrong += [
        f"{path}: loads from another host"
        for path in site.rglob("*.css")
        if re.search(r"(url\(|@import)\s*['\"]?(https?:)?//", path.read_text("utf-8"))
    ]
    return wrong


def make_site(site: Path) -> None:
    shutil.rmtree(site, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(Path(folder))
        for page in PAGES[1:]:
            stage.write(staged(page), stage.page(page))
        reference = reference_pages()
        for name, text in reference.items():
            stage.write(f"{name}.md", text)
        sections = {name: [staged(page).removesuffix(".md") for page in pages] for name, pages in MENU.items()}
        menus = [menu(name, pages) for name, pages in {**sections, "Python reference": list(reference)}.items()]
        stage.write("index.md", "".join([IMAGE.sub(PLAYER, stage.page("README.md"), count=1), *menus]))
        subprocess.run(
            [
                sys.executable,
                "-m",
                "sphinx",
                "-W",
                "--keep-going",
                "-q",
                "-c",
                SETTINGS,
                "-d",
                f"{folder}/.doctrees",
                folder,
                site,
            ],
            check=True,
        )
    make_player(site / "player.html")
    if wrong := broken_links(site):
        raise SystemExit("\n".join(wrong))


if __name__ == "__main__":
    make_site(Path(sys.argv[1]).resolve())
