"""The script `pdecodec`, and `python -m pdecodec`, which runs the same program with the chosen interpreter.

Little is imported before interrupts are handled, because importing the command takes a while.
"""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; if interrupted before anything has begun, end without a message."""
    try:
        from pdecodec.cli.interrupts import watch_interrupts

        watch_interrupts()
        from pdecodec.cli.main import main as command

        command()
    except KeyboardInterrupt:
        sys.exit(130)  # equals pdecodec.cli.main.EXIT_INTERRUPTED


if __name__ == "__main__":
    main()
