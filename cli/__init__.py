"""The command line, `pdecodec` or `python -m pdecodec`: a shell around the library, without codec logic.

Begin with `main.py`: it finds the command and turns failures into one line and an exit code. Each command has a module,
or shares one with a related command (`main.MODULES`). `options.py` holds the options that several commands take,
`jobs.py` what `encode`, `decode` and `convert` do for every input (folders, pipes, dry runs), `console.py` everything
that is printed. Commands import what they use when they run, so that help pages load fast.
"""

if __name__ != "pdecodec.cli":
    raise ImportError(f"this package is imported as pdecodec.cli, not as {__name__}")
