"""Objects beyond us: refused with one line, or left out and counted."""

from __future__ import annotations

from pdecodec.errors import InputError
from pdecodec.sequence import Unsupported


class Refusals:
    """What a reader does about objects that it cannot read.

    Parameters
    ----------
    skip : bool
        Leave them out, instead of refusing the file.
    """

    def __init__(self, *, skip: bool) -> None:
        self._skip = skip
        self.found: list[Unsupported] = []

    def refuse(self, name: str, feature: str, frame: int | None = None) -> None:
        """Note an object that cannot be read.

        Raises
        ------
        InputError
            Unless such objects are left out.
        """
        if not self._skip:
            raise InputError(f"object {name!r} has {feature}; --skip-unsupported goes on without it", frame=frame)
        self.found.append(Unsupported(name, feature, frame))

    @property
    def notices(self) -> tuple[str, ...]:
        """A line for each object that was left out."""
        return tuple(
            f"object {item.name!r} is left out: it has {item.feature}"
            + ("" if item.frame is None else f" at frame {item.frame}")
            for item in self.found
        )

    def check_left(self, objects: int, kinds: str) -> None:
        """Refuse a file without any object that can be read.

        Parameters
        ----------
        objects : int
            How many can.
        kinds : str
            What is there instead, ``"2 cameras"``; empty for nothing.
        """
        if objects:
            return
        if self.found:
            first = self.found[0]
            raise InputError(f"nothing is left of it: object {first.name!r} has {first.feature}", frame=first.frame)
        raise InputError(f"holds no mesh, curve or point animation: there is {kinds or 'nothing at all'}")
