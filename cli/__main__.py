"""`python -m pdecodec.cli`: the same as `python -m pdecodec`."""

from pdecodec.__main__ import main

main()
