"""The browser player: scripts and the decoder as WebAssembly, an npm package that comes with the Python package too."""

from pathlib import Path

if __name__ != "pdecodec.player":
    raise ImportError(f"import this package as pdecodec.player, not as {__name__}")

FOLDER = Path(__file__).resolve().parent
