"""The command line: `pdecodec`, or `python -m pdecodec`. A shell around the library, without codec logic.

Begin with `main.py`: it finds the command of a line and turns failures into one line and an exit code. Each command has
a module, or shares one with a command that shows the same kind of thing (`main.MODULES`). `options.py` has the options
that several commands take, `jobs.py` what `encode`, `decode` and `convert` do for every input (folders, pipes, dry
runs), `console.py` whatever is printed. Commands import what they use when they run, so that a help page is light.
"""

if __name__ != "pdecodec.cli":
    raise ImportError(f"this package is imported as pdecodec.cli, not as {__name__}")
