"""`python -m pdecodec.cli`, as `python -m pdecodec`."""

from pdecodec.__main__ import main

main()
