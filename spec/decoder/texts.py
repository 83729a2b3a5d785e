"""Section 3.9 of the specification: texts and bytes in a coded stream."""

from __future__ import annotations

from spec.decoder.contexts import Contexts
from spec.decoder.fields import CorruptFileError

END = 255
HASH_FACTOR = 0x9E3779B1
PAST = 1 << 16
LONGEST = 15
BYTE_WEIGHTS = {4: 19660}
PRIMER = (
    b"uv\xffuv:UVMap\xffuv:map1\xffuv:st\xffuv:TEXCOORD_1\xffcolor\xffcolor:Cd\xffcolor:COLOR_0\xffmaterial\xffgroup\xff"
    b"object\xffsmoothing\xffnormal_group\xffsubdivision\xffcatmull-clark\xffcurve_basis\xfftransform\xffdisplayOpacity\xff"
    b"Material.001\xffinitialShadingGroup\xfflambert1SG\xffmesh\xff/root/Armature/BodyShape\xff/World/Geometry/Cube\xff"
    b"Sphere_002/SphereShape_003\xffdefault\xffpCube1|pCubeShape1\xffPlane_0001\xffCylinder_10\xff"
)


class ByteModel:
    """Bytes that follow one another, with what came after when the last ones were as now."""

    def __init__(self, contexts: Contexts, name: str, primer: bytes = b"") -> None:
        self._contexts = contexts
        self._name = name
        self._past: list[int] = []
        self._places: dict[int, int] = {}
        self._place = -1
        self._run = 0
        with contexts.rehearsing(byte >> digit & 1 for byte in primer for digit in reversed(range(8))):
            self.read_bytes(len(primer))

    def read(self) -> int:
        """The next byte."""
        self._contexts.check_not_ended()
        past, count = self._past, len(self._past)
        last = int.from_bytes(bytes(past[-4:]), "big")
        slot = last * HASH_FACTOR % 2**32 >> 20
        if self._place < 0 or count - self._place > PAST:
            self._place, self._run = self._places.get(slot, -1), 0
            if count - self._place > PAST:
                self._place = -1
        self._places[slot] = count
        proposed = 256 + past[self._place] if self._place >= 0 else 0
        run = min(self._run, LONGEST)
        found = 1
        for digit in reversed(range(8)):
            agrees = proposed >> digit + 1 == found
            found = 2 * found + self._contexts.mixed(
                (self._name, 1 + min(run, 3) if agrees else 0),
                (last % 256, found),
                ((last % 2**16 * 256 + found) * HASH_FACTOR % 2**32 >> 16,),
                ((last % 2**24 * 256 + found) * HASH_FACTOR % 2**32 >> 16,),
                (run, proposed >> digit & 1) if agrees else (),
                of=(self._name,),
            )
        if self._place >= 0 and found == proposed:
            self._place += 1
            self._run += 1
        else:
            self._place = -1
        past.append(found % 256)
        return found % 256

    def read_bytes(self, count: int) -> bytes:
        """The next bytes."""
        return bytes(self.read() for _ in range(count))

    def read_text(self) -> str:
        """Bytes up to the end of a text."""
        text = bytearray()
        while (byte := self.read()) != END:
            text.append(byte)
        try:
            return text.decode("utf-8")
        except UnicodeDecodeError:
            raise CorruptFileError("a text is not UTF-8") from None
