"""`pdecodec info --json` of a rich file of each format, against what the format's own library lists of it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from pdecodec.cli.main import run
from tests.support.scene_cases import needed


def alembic(folder: Path) -> tuple[Path, Counter[str]]:
    """An archive, and how often the library lists each name of a property."""
    from tests.formats.test_alembic_inventory import everything, listing

    path = everything(folder / "x.abc")
    return path, Counter(one.rpartition("/")[2] for one in listing(path) if ":" in one)


def usd(folder: Path) -> tuple[Path, Counter[str]]:
    """A stage, and how often its flattened layer has each type of prim, property and key of metadata."""
    from pxr import Usd

    from tests.formats.test_usd_inventory import SHOP, listing

    path = folder / "x.usda"
    # Flattened layers have no inactive prims.
    path.write_text(SHOP.replace("active = false", "hidden = true"))
    stage = Usd.Stage.Open(str(path))
    found = Counter(key or place.partition(".")[2] for place, key in listing(path))
    del found[""]
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.PrimAllPrimsPredicate)
    return path, found + Counter(prim.GetTypeName() or "prim" for prim in list(prims)[1:])


EXPECTED = {
    alembic: {"coded": ("P", ".faces", "visible"), "dropped": ("studio", "width"), "implied": (".selfBnds",)},
    usd: {
        "coded": ("points", "Mesh", "primvars:kept", "upAxis"),
        "implied": ("extent", "defaultPrim"),
        "dropped": ("velocities", "Camera", "look=old", "PhysicsRigidBodyAPI", "renderSettingsPrimPath"),
    },
}


@pytest.mark.parametrize("make", EXPECTED)
def test_info_counts_what_a_file_holds_by_what_becomes_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], make: Callable[[Path], tuple[Path, Counter[str]]]
) -> None:
    needed({alembic: "abc", usd: "usda"}[make])
    path, listed = make(tmp_path)
    shown = []
    for options in ([], ["--isolate"]):
        assert run(["info", str(path), "--skip-unsupported", "--json", *options]) == 0
        shown.append(json.loads(capsys.readouterr().out)["contents"])
    assert shown[0] == shown[1]
    counts: Counter[str] = Counter()
    for one in shown[0]:
        counts[one["kind"].rpartition("/")[2]] += one["count"]
    assert {kind: counts[kind] for kind in listed} == dict(listed)
    for fate, kinds in EXPECTED[make].items():
        assert {one["kind"] for one in shown[0] if one["fate"] == fate} >= set(kinds)
