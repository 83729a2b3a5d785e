"""`python -m pdecodec.cli`, as `python -m pdecodec`."""

from pdecodec.cli.main import main

main()
