"""Errors carry data: codes that never change, fields that survive pickling; no command-line options in
messages, and no code that parses messages.
"""

from __future__ import annotations

import ast
import errno
import pickle
import re
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import pytest

import pdecodec
from pdecodec import errors
from pdecodec.cli.main import COMMANDS
from pdecodec.cli.main import pdecodec as commands
from pdecodec.errors import ErrorCode, InputError, LimitError, Notice, PdecodecError, SettingsError
from pdecodec.formats import open_sequence
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject

ROOT = Path(__file__).resolve().parents[2]


def options_of(name: str) -> set[str]:
    """Return the long options of a command."""
    command = commands.get_command(click.Context(commands), name)
    assert command is not None
    return {option for parameter in command.params for option in parameter.opts if option.startswith("--")} | {"--help"}


CODES = re.findall(
    r"[a-z-]+",
    """
failed invalid-setting conflicting-settings setting-unsupported unknown-name frame-out-of-range time-out-of-range
invalid-input invalid-faces invalid-attribute invalid-field file-missing unreadable outside-folder unknown-format
unsupported-format
ambiguous-input frame-missing
no-frames no-vertices damaged-input file-changed unsupported-feature object-missing object-mismatch
connectivity-changes invalid-times not-finite too-large interrupted worker-ended output-exists output-unwritable
disk-full overwrites-input corrupt-file identifier version header-checksum table table-checksum truncated
trailing-bytes section-unknown section-unknown-required section-checksum section-content group-checksum group-content
memory-limit output-limit missing-extra
""",
)


def test_codes_stay_what_they_are() -> None:
    assert [*ErrorCode] == CODES


def test_the_page_about_errors_lists_every_code() -> None:
    page = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z-]+)` \| (.+) \|$", page.split("| code | meaning |")[1], re.MULTILINE)
    assert rows == [(code.value, code.description) for code in ErrorCode]


@pytest.mark.parametrize(
    "kind", [one for one in vars(errors).values() if isinstance(one, type) and issubclass(one, PdecodecError)]
)
def test_errors_survive_pickling_with_all_they_carry(kind: type[PdecodecError]) -> None:
    error = kind(
        "is odd",
        code="not-finite",
        path="a.obj",
        object="b",
        frame=3,
        section="COEF",
        offset=7,
        limit="max_memory",
        setting="mesh",
        value=2,
        purpose="to see",
    )
    for again in (pickle.loads(pickle.dumps(error)), kind(**error.fields())):
        assert (type(again), str(again), vars(again)) == (kind, str(error), vars(error))
    moved = error.placed("is odder", path=Path("c.obj"), frame=4)
    assert (moved.path, moved.frame, moved.object, moved.code) == ("c.obj", 4, "b", "not-finite")
    assert (error.path, error.frame, error.message) == ("a.obj", 3, "is odd")


def test_a_missing_file_is_what_python_calls_it(tmp_path: Path) -> None:
    place = tmp_path / "none.pdeanim"
    for read in (pdecodec.open, pdecodec.open_sequence, pdecodec.encode, pdecodec.check_file):
        with pytest.raises(FileNotFoundError) as caught:
            read(place)
        error = caught.value
        assert isinstance(error, InputError)
        assert (error.errno, error.filename, error.code) == (errno.ENOENT, str(place), "file-missing")
    assert not isinstance(InputError("is odd"), OSError)


def test_a_message_has_place_cause_and_the_setting_to_change() -> None:
    assert str(InputError("is odd", path="a.obj", object="b", frame=3, offset=7)) == (
        "a.obj, object 'b', frame 3, byte 7: is odd"
    )
    taken = InputError("exists already", setting="overwrite", purpose="to replace it")
    assert str(taken) == "exists already; set overwrite to replace it"
    assert taken.worded("--overwrite", "pass --overwrite") == "exists already; pass --overwrite to replace it"
    assert str(InputError("is in cm", setting="scale", value=0.01)) == "is in cm; set scale=0.01"
    assert str(SettingsError("must be 1 or more", setting="fps")) == "fps must be 1 or more"
    assert str(LimitError("the limit is 5", limit="max_memory")) == (
        "the limit is 5; raise max_memory if you trust the file"
    )


def test_notices_are_text_that_knows_its_setting() -> None:
    notice = Notice("assumed 24", setting="fps", value="30", purpose="to change it")
    for same in (notice, pickle.loads(pickle.dumps(notice))):
        assert (same, same.setting) == ("assumed 24; set fps=30 to change it", "fps")
        assert same.worded("--fps", "pass --fps 30") == "assumed 24; pass --fps 30 to change it"


def sources(*folders: str) -> list[tuple[str, ast.AST]]:
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    return [(str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8"))) for path in files]


def test_no_text_of_the_library_names_an_option_of_the_command_line() -> None:
    # Style sheets, a program with its own command line, and the name of a coder in a table.
    own = {"report/charts/page.py", "report/charts/vegalite.py", "research/bench.py", "research/reproduction/rates.py"}
    options = {option for name in COMMANDS for option in options_of(name)}
    found = []
    for place, tree in sources("pdecodec", "formats", "batch", "report", "research"):
        documentation = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
                named = set(re.findall(r"--[a-z][a-z-]*", node.value)) & options
                found += [(place, node.lineno, *named)] if named and place not in own else []
    assert found == []


def test_every_setting_that_an_error_names_is_one_of_a_function() -> None:
    trees = sources("pdecodec", "formats", "batch", "report")
    parameters = {
        argument.arg
        for _, tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        for argument in (*node.args.args, *node.args.kwonlyargs)
    }
    fields = {
        node.target.id
        for _, tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    named = {
        word.value.value
        for _, tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        for word in node.keywords
        if word.arg in ("setting", "limit") and isinstance(word.value, ast.Constant)
    }
    assert {"mesh", "fps", "max_memory"} <= named - {None}
    assert named - {None} <= parameters | fields


def test_no_code_parses_the_message_of_an_error() -> None:
    """Assert that code neither tests nor parses `error.message` or ``str(error)``."""

    def is_words(node: ast.AST) -> bool:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "str" and node.args:
            return isinstance(node.args[0], ast.Name) and node.args[0].id in ("error", "refused", "caught")
        return isinstance(node, ast.Attribute) and node.attr == "message"

    # Methods that may be applied to errors of other libraries, of whose messages the last line is shown.
    shown = {"strip", "split", "splitlines"}
    found = []
    for place, tree in sources("pdecodec", "formats", "batch", "report", "research", "cli"):
        for node in ast.walk(tree):
            asked: list[ast.AST] = []
            if isinstance(node, ast.Compare):
                asked = [node.left, *node.comparators]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr not in shown:
                asked = [node.func.value, *(node.args if node.func.attr in ("search", "match", "fullmatch") else ())]
            elif isinstance(node, ast.Subscript):
                asked = [node.value]
            found += [(place, node.lineno) for one in asked if is_words(one)]
    # USD's own exception gives the line of a file only in its text.
    assert {place for place, _ in found} <= {"formats/usd/composition.py"}


@pytest.mark.parametrize(
    ("code", "fails"),
    [
        ("invalid-faces", lambda: Connectivity(3, [3], [0, 1, 3])),
        ("invalid-faces", lambda: Connectivity(3, [2], [0, 1])),
        ("invalid-faces", lambda: Connectivity(3, [4], [0, 1, 2])),
        ("invalid-attribute", lambda: MeshObject("o", Connectivity(3), (Attribute("a", "vertex", np.zeros(2)),))),
    ],
)
def test_meshes_that_contradict_themselves_have_codes_of_their_own(code: str, fails: Callable[[], object]) -> None:
    with pytest.raises(InputError) as failed:
        fails()
    assert failed.value.code == code


def test_an_archive_that_breaks_its_layout_is_damaged(tmp_path: Path) -> None:
    for name, arrays in (("none", {}), ("text", {"points": np.zeros((1, 2, 3)), "metadata": np.zeros(3)})):
        np.savez(tmp_path / name, **arrays)
        with pytest.raises(InputError) as failed:
            open_sequence(tmp_path / f"{name}.npz")
        assert failed.value.code == "damaged-input"


def test_a_notice_of_an_isolated_reader_keeps_its_setting(tmp_path: Path) -> None:
    np.savez(tmp_path / "line.npz", points=np.zeros((2, 3, 3), np.float32))
    with open_sequence(tmp_path / "line.npz") as here, open_sequence(tmp_path / "line.npz", isolate=True) as there:
        assert [vars(one) for one in there.notices] == [vars(one) for one in here.notices]
        assert there.notices[0].setting == "fps"
