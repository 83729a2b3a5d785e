"""The documents are correct: code blocks of the README run, and the help pages in docs/ match the commands."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import tomllib
from itertools import chain
from pathlib import Path

import pytest

from pdecodec.cli.main import run as pdecodec_run

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SITE = ["README.md", *chain(*tomllib.loads((ROOT / "docs/site/pages.toml").read_text(encoding="utf-8")).values())]

INSTALLED_ALREADY = "pip install"
"""Beginning of commands that tests do not run, because the package under test is installed already."""


RUN = {
    "README.md": 12,
    "docs/README.md": 12,
    "docs/encoder.md": 1,
    "docs/fields.md": 6,
    "docs/pipelines.md": 6,
    "docs/web.md": 4,
    **{page: 2 for page in SITE if "/tutorials/" in page},
}
"""Pages whose code runs, and the least number of commands and programs on each."""


def run_command(command: str, shown: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Run a command of a page, except if it installs the package; its output has the lines that the page shows."""
    program, *arguments = shlex.split(command)
    if command.startswith(INSTALLED_ALREADY):
        return
    assert program == "pdecodec", f"the page runs {program}, which is not ours to test"
    capsys.readouterr()
    assert pdecodec_run(arguments) == 0, command
    printed = "".join(capsys.readouterr()).splitlines()
    assert [line for line in shown if line not in printed] == [], f"{command} prints {printed}"


@pytest.mark.parametrize("page", RUN)
def test_the_code_of_a_page_runs_in_order(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    done = 0
    text = (ROOT / page).read_text(encoding="utf-8")
    if page == "docs/pipelines.md":
        pytest.importorskip("dask")
        Path("clips.csv").write_text(text.split("```csv\n")[1].split("```")[0], encoding="utf-8")
    for language, code in re.findall(r"^```(console|python)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        if language == "python":
            exec(compile(code, page, "exec"), names)
            done += 1
        else:
            for command, *shown in (part.splitlines() for part in code.removeprefix("$ ").split("\n$ ")):
                run_command(command, shown, capsys)
                done += 1
    assert done >= RUN[page]


def test_the_site_has_every_document_once() -> None:
    folders = ("*.md", "docs/**/*.md", "spec/**/*.md", "player/*.md", "plugins/*/*.md", "examples/*/*.md")
    documents = [path.relative_to(ROOT).as_posix() for folder in folders for path in ROOT.glob(folder)]
    assert sorted(SITE) == sorted(documents), "list the page in docs/site/pages.toml"


@pytest.mark.parametrize("document", SITE)
def test_every_link_of_a_document_leads_to_a_file(document: str) -> None:
    page = ROOT / document
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert target.startswith("https://") or (page.parent / target).exists(), f"{document} links to {target}"


def test_every_place_in_the_code_that_contributing_names_is_there() -> None:
    named = re.findall(
        r"`((?:batch|cli|core|formats|pdecodec|player|report)/[^`\s]*)`", (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    )
    assert len(named) >= 10
    assert [place for place in named if not (ROOT / place).exists()] == []


def test_the_map_of_equations_leads_to_where_they_are_named() -> None:
    table = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("| Eqs. |")[1].split("\n\n")[0]
    rows = [line.strip("|").split("|") for line in table.splitlines()[2:]]
    assert len(rows) >= 5
    for equations, _, places in rows:
        files = re.findall(r"`([^`]+)`", places)
        found = {place: equations_in((ROOT / place).read_text(encoding="utf-8")) for place in files}
        wanted = set(map(int, equations.split(",")))
        assert wanted <= set().union(*found.values()), f"Eqs. {equations} are not all named in {files}"
        assert all(wanted & own for own in found.values()), f"none of Eqs. {equations} is named in one of {files}"


def equations_in(text: str) -> set[int]:
    """Numbers of equations that a file names: 'Eq. 25', 'Eqs. 6 and 7', 'Eqs. 19 to 23'."""
    numbers: set[int] = set()
    for named in re.findall(r"\bEqs?\. (\d+(?:(?:, | and | to )\d+)*)", text):
        numbers |= set(map(int, re.findall(r"\d+", named)))
        for first, last in re.findall(r"(\d+) to (\d+)", named):
            numbers |= set(range(int(first), int(last) + 1))
    return numbers


def test_every_figure_that_the_readme_quotes_of_the_paper_is_in_the_run_that_is_kept() -> None:
    section = README.split("## What we found in the paper")[1].split("\n## ")[0]
    quoted = set(re.findall(r"\d+\.\d{2,}|\d+(?:\.\d+)? %", section))
    assert len(quoted) > 4
    folder = ROOT / "docs" / "paper"
    kept = "".join((folder / name).read_text(encoding="utf-8") for name in ("verdicts.md", "report.json"))
    for figure in quoted:
        assert figure.replace(" %", "%") in kept, (
            f"the README quotes {figure}, which the run in docs/paper does not have"
        )


def test_the_audit_is_answered_with_figures_of_the_run_that_is_kept() -> None:
    folder = ROOT / "docs" / "paper"
    page = (folder / "audit.md").read_text(encoding="utf-8")
    records = [json.loads((folder / name).read_text(encoding="utf-8")) for name in ("report.json", "stability.json")]
    tables = [(folder / name).read_text(encoding="utf-8") for name in ("verdicts.md", "one-choice-at-a-time.md")]
    kept = "".join([*tables, *map(json.dumps, records)])
    quoted = set(re.findall(r"\d+\.\d+|\d+%|\de-\d\d", page))
    assert len(quoted) > 40
    assert [figure for figure in quoted if figure not in kept] == []
    charts = {name for record in records for name in record["figures"]}
    named = set(re.findall(r"`([a-z0-9]+(?:-[a-z0-9]+)+)`", page))
    assert len(named) > 10
    assert named <= charts
    numbered = re.findall(r"^\| (\d+) \|", page, re.MULTILINE)
    assert numbered == [str(number) for number in range(1, 11)]


def test_the_readme_lists_every_registered_extension() -> None:
    from pdecodec.formats import list_formats

    for entry in list_formats():
        for extension in entry.extensions:
            assert f"`{extension}`" in README


@pytest.mark.parametrize(
    ("maker", "page", "function"),
    [
        ("make_cli", "cli", "help_pages"),
        ("make_formats", "formats", "formats_page"),
        ("make_encoder", "encoder", "encoder_page"),
    ],
)
def test_the_pages_in_docs_are_those_of_the_code(maker: str, page: str, function: str) -> None:
    spec = importlib.util.spec_from_file_location(maker, ROOT / "docs" / f"{maker}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    written = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    assert written == getattr(module, function)(), "what the page tells of changed: run `make docs`"
