"""`python -m pdecodec.cli`."""

from pdecodec.cli.main import main

main()
