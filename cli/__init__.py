"""The command line: `pdecodec`, or `python -m pdecodec`. A shell around the library, without codec logic."""

if __name__ != "pdecodec.cli":
    raise ImportError(f"this package is imported as pdecodec.cli, not as {__name__}")
