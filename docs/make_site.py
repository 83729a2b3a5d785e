"""Build the documentation as a site: `python docs/make_site.py build/site` (or `make site`).

Copies the Markdown files that `docs/site/pages.toml` lists to a folder, and adds the player on the first page and the
reference of Python. Sphinx makes the site from this folder; every warning is an error. Then all links of the site are
checked; broken ones are errors, and so are files that a page loads from other hosts. The theme is furo: its pages,
search included, work from a local folder.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
import tempfile
import tomllib
from html import unescape
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = ROOT / "docs" / "site"
MENU: dict[str, list[str]] = tomllib.loads((SETTINGS / "pages.toml").read_text(encoding="utf-8"))
PAGES = ("README.md", *(page for pages in MENU.values() for page in pages))

REFERENCE = {
    "Encode": r"pdecodec\.codec\.(encod|settings)",
    "Decode": r"pdecodec\.codec\.(opening|decoder|array_evaluator|paper_form|source)",
    "Check, repair, cut and join": r"pdecodec\.codec\.(checking|mending|salvaging|editing)",
    "Meshes and files": r"pdecodec\.(mesh|formats)",
    "Errors": r"pdecodec\.errors",
}
"""Pages of the reference, each with a pattern of the modules whose public names it has."""

SIMULATE = "simulate cloth -o cloth.npz --drape sphere --columns 60 --rows 60 --frames 72"
PLAYER = """
<iframe class="player" src="player.html" title="A clip in the player: drag to rotate" loading="lazy"></iframe>
<p class="caption">A simulated cloth of {source:.1f} MB in a file of {coded:.0f} kB, decoded in this page; drag it.</p>
"""

FOREIGN = re.compile(r"(url\(|@import)\s*['\"]?(https?:)?//")
FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)
IMAGE = re.compile(r"!\[[^\]]*\]\([^)]+\)")
LINK = re.compile(r"(!?)\[([^\[\]]*)\]\(([^()\s#]+)(#[^()\s]*)?\)")


def staged(page: str) -> str:
    """Return where a file of the repository stands in the site; a folder's README is its index."""
    return re.sub(r"(^|/)README\.md$", r"\1index.md", page)


def repository() -> str | None:
    """Return the address of the repository: that of pyproject.toml, or of the hosted run; None if neither has one."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"].get("urls", {})
    if "GITHUB_REPOSITORY" in os.environ:
        urls.setdefault("Repository", "{GITHUB_SERVER_URL}/{GITHUB_REPOSITORY}".format_map(os.environ))
    return urls.get("Repository")


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
    """Return the pages of the reference of Python by name: directives for the docstrings of all public names."""
    import pdecodec

    pages = {title: [f"# {title}", "", "```{eval-rst}"] for title in REFERENCE}
    public = {name: getattr(pdecodec, name) for name in pdecodec.__all__ if name not in ("__version__", "open")}
    for name, value in sorted(public.items(), key=lambda item: isinstance(item[1], type)):  # functions first
        [title] = [title for title, modules in REFERENCE.items() if re.match(modules, value.__module__)]
        lines = [f".. autoclass:: pdecodec.{name}", "   :members:"]
        lines += ["   :show-inheritance:"] if "pdecodec" in str(getattr(value, "__bases__", "")) else []
        pages[title] += lines if isinstance(value, type) else [f".. autofunction:: pdecodec.{name}"]
    names = {title: f"reference/{title.split(',')[0].lower().replace(' ', '-')}" for title in pages}
    return {names[title]: "\n".join([*lines, "```", ""]) for title, lines in pages.items()}


def make_player(page: Path) -> str:
    """Write the viewer's page of a clip that is simulated and encoded now; return the element that shows it."""
    from pdecodec.cli.main import run

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for command in (SIMULATE, "encode cloth.npz -o cloth.pdeanim", "view cloth.pdeanim -o cloth.html"):
            if run(command.split()) != 0:
                raise SystemExit(f"pdecodec {command} failed")
        source, coded = (Path(f"cloth.{kind}").stat().st_size for kind in ("npz", "pdeanim"))
        text = Path("cloth.html").read_text(encoding="utf-8")
    style = (SETTINGS / "player.css").read_text(encoding="utf-8")
    page.write_text(text.replace("</style>", f"{style}</style>", 1), encoding="utf-8")
    return PLAYER.format(source=source / 1e6, coded=coded / 1e3)


def broken_links(site: Path) -> list[str]:
    """Return what is wrong with the links of a site: files and anchors that are not there, files of other hosts."""
    texts = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    anchors = {path: set(re.findall(r'\sid="([^"]+)"', text)) for path, text in texts.items()}
    styles = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.css")}
    wrong = [f"{path}: loads from another host" for path, text in styles.items() if FOREIGN.search(text)]
    for path, text in texts.items():
        for tag, link in re.findall(r'<(\w+)\s[^>]*?(?:href|src)="([^"]*)"', text):
            parts = urlsplit(unescape(link))
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if parts.scheme or parts.netloc:
                found = tag == "a"
            else:
                found = target.is_file() and unquote(parts.fragment) in {"", *anchors.get(target, [])}
            if not found:
                wrong.append(f"{path.relative_to(site)}: {link} leads to nothing, or to another host")
    return wrong


def make_site(site: Path) -> None:
    """Make the site in a folder, which is emptied first; exit with a message if anything is wrong with it."""
    from sphinx.cmd.build import main as sphinx

    if site.exists():
        if any(site.iterdir()) and not (site / "player.html").exists():
            raise SystemExit(f"{site} holds something else than a site, and would be emptied")
        shutil.rmtree(site)
    site.mkdir(parents=True)
    player = make_player(site / "player.html")
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(Path(folder))
        for page in PAGES[1:]:
            stage.write(staged(page), stage.page(page))
        reference = reference_pages()
        for name, text in reference.items():
            stage.write(f"{name}.md", text)
        sections = {name: [staged(page).removesuffix(".md") for page in pages] for name, pages in MENU.items()}
        menus = [menu(name, pages or list(reference)) for name, pages in sections.items()]
        stage.write("index.md", IMAGE.sub(player, stage.page("README.md"), count=1) + "".join(menus))
        if sphinx(["-W", "--keep-going", "-q", "-c", str(SETTINGS), "-d", f"{folder}/.doctrees", folder, str(site)]):
            raise SystemExit("Sphinx warns of the above")
    if wrong := broken_links(site):
        raise SystemExit("\n".join(wrong))


if __name__ == "__main__":
    make_site(Path(sys.argv[1]).resolve())
