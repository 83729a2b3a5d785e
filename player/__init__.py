"""The browser player: JavaScript and the WebAssembly decoder; published on npm and shipped in the Python package."""

from pathlib import Path

if __name__ != "pdecodec.player":
    raise ImportError(f"import this package as pdecodec.player, not as {__name__}")

FOLDER = Path(__file__).resolve().parent
