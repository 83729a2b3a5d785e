"""Print the version of usd-core, its library, and the folders of headers of the same version, for CMake."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

MODULES = ("ar", "arch", "boost", "gf", "js", "pcp", "plug", "sdf", "tf", "trace", "ts", "vt", "work")
"""Modules of OpenUSD whose headers the plug-in includes, by name of package: pxr-NAME-dev.

There is none of pcp for older versions; without it no scenes are shown.
"""


def main() -> None:
    version = metadata.version("usd-core")
    files = metadata.files("usd-core") or []
    (library,) = [Path(one.locate()) for one in files if "libusd_ms" in one.name]
    found = [version, library, headers_of("tbb", None) / "TBB/include"]
    has_scenes = any(one.metadata["Name"] == "pxr-pcp-dev" for one in metadata.distributions())
    modules = [one for one in MODULES if has_scenes or one != "pcp"]
    found += [headers_of(module, version) / f"pxr-{module}/include" for module in modules]
    print(*found, sep=";")


def headers_of(module: str, version: str | None) -> Path:
    """Return the folder that the package of a module's headers is installed in; end if it is not of a version."""
    try:
        found = metadata.distribution(f"pxr-{module}-dev")
    except metadata.PackageNotFoundError:
        sys.exit("the headers of usd-core are missing: install the package pxr-pcp-dev of the version of usd-core")
    if version not in (None, found.version):
        sys.exit(f"usd-core {version} needs headers of its version, not of {found.version}: pxr-pcp-dev=={version}")
    return Path(str(found.locate_file("")))


if __name__ == "__main__":
    main()
