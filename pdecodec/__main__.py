"""`python -m pdecodec` is the `pdecodec` script, of this very interpreter."""

from pdecodec.cli.main import main

if __name__ == "__main__":
    main()
