"""Sections 3.5, 3.6, 3.8 and 3.9 of the specification: named models of a coded stream, numbers, matches, texts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from spec.decoder.fields import CorruptFileError, require
from spec.decoder.rangecoder import INITIAL_MODEL, RangeDecoder, Rehearsal, adapt_model

HALF = 1 << 15
MAX_DIGITS = 32
HASH_FACTOR = 0x9E3779B1
LONG_MATCH, SHORT_MATCH = 6, 3
MAX_MATCH_DISTANCE, MAX_BYTE_DISTANCE = 1 << 14, 1 << 16
LONGEST_RUN = 63
END_OF_TEXT = 255
PRIMER = (
    b"uv\xffuv:UVMap\xffuv:map1\xffuv:st\xffuv:TEXCOORD_1\xffcolor\xffcolor:Cd\xffcolor:COLOR_0\xffmaterial\xffgroup\xff"
    b"object\xffsmoothing\xffnormal_group\xffsubdivision\xffcatmull-clark\xffcurve_basis\xfftransform\xffdisplayOpacity\xff"
    b"Material.001\xffinitialShadingGroup\xfflambert1SG\xffmesh\xff/root/Armature/BodyShape\xff/World/Geometry/Cube\xff"
    b"Sphere_002/SphereShape_003\xffdefault\xffpCube1|pCubeShape1\xffPlane_0001\xffCylinder_10\xff"
)
FIRST_WEIGHTS = {2: 39321, 3: 26214, 4: 19660, 7: 14500}

Name = tuple[object, ...]


class History:
    """3.5: a history of `size` bits, into which new values are shifted."""

    def __init__(self, size: int) -> None:
        self.value = 0
        self._size = size

    def add(self, value: int, size: int = 1) -> None:
        self.value = (self.value << size | value) % (1 << self._size)


class Contexts:
    """A coded stream with named bit models and weights."""

    def __init__(self, data: bytes) -> None:
        self._coder = RangeDecoder(data)
        self._models: list[int] = []
        self._numbers: dict[Name, int] = {}
        self._weights: dict[Name, list[int]] = {}

    def _model(self, name: Name) -> int:
        number = self._numbers.setdefault(name, len(self._models))
        if number == len(self._models):
            self._models.append(INITIAL_MODEL)
        return number

    def bypass(self, bits: int = 1) -> int:
        value = 0
        for _ in range(bits):
            value = 2 * value + self._coder.bit_with(HALF)
        return self._sound(value)

    def bit(self, *name: object) -> int:
        return self._sound(self._coder.bit(self._models, self._model(name)))

    def mixed(
        self, weights: Name, *names: Name, of: Name | None = None, into: History | None = None, shift: int = 14
    ) -> int:
        """Read a mixed bit, and shift it into a history if given. Names of the inputs start with `of`, or else
        with the weights' name.
        """
        if weights not in self._weights:
            self._weights[weights] = [FIRST_WEIGHTS[len(names)]] * len(names)
        family = weights if of is None else of
        inputs = [self._model((*family, place, *name)) for place, name in enumerate(names)]
        bit = self._sound(self._coder.mixed(self._models, inputs, self._weights[weights], shift))
        if into:
            into.add(bit)
        return bit

    def trust(self, name: Name, bit: int, times: int) -> None:
        """Let a model begin as if it had adapted to `bit` this many times."""
        if name not in self._numbers:
            model = self._model(name)
            for _ in range(times):
                self._models[model] = adapt_model(self._models[model], bit)

    def counted(self, most: int, *name: object) -> int:
        """Read a number of 1 to `most` binary digits, 1 or more."""
        digits = 1 + choose(most, lambda less: not self.bit(*name, less + 1))
        return 1 << digits - 1 | self.bypass(digits - 1)

    def number(self, *name: object) -> int:
        """Read a number from 0 to 2^32 - 2."""
        digits = 1 + choose(MAX_DIGITS, lambda less: not self.bit(*name, "more", less + 1))
        return self.digits(digits, 8, *name, "digit") - 1

    def signed(self, *name: object) -> int:
        if self.bit(*name, "zero"):
            return 0
        negative = self.bit(*name, "sign")
        magnitude = self.number(*name, "magnitude", negative) + 1
        return -magnitude if negative else magnitude

    def digits(self, length: int, end: int, *name: object) -> int:
        """Read a number of `length` binary digits: a 1, then bits with models while it is below `end`, then
        bypass bits.
        """
        value = 1
        for _ in range(length - 1):
            value = 2 * value + (self.bit(*name, length, value) if value < end else self.bypass())
        return value

    @contextmanager
    def rehearsing(self, bits: Iterable[int]) -> Iterator[None]:
        """Let the models adapt to known bits, as if they had been in the stream."""
        coder, self._coder = self._coder, Rehearsal(bits)
        yield
        self._coder = coder

    def _sound(self, read: int) -> int:
        """Return a value just read; refuse the file if its bytes ended so early that 3.7 must fail."""
        require(not self._coder.has_ended(), "a coded stream ends too early")
        return read

    def finish(self) -> None:
        """3.7: check the end of the stream."""
        require(self._coder.is_finished(), "a coded stream does not end with its contents")


def find_length(expected: int, most: int, decide: Callable[[int, int], int]) -> int:
    """7.6: search a length up or down from the expected one; `decide(l, way)` tells whether it is l or more."""
    length = expected
    if decide(length, 0):
        while length < most and decide(length + 1, 1):
            length += 1
        return length
    length -= 1
    while length > 0 and not decide(length, 2):
        length -= 1
    return length


def choose(count: int, is_right: Callable[[int], int]) -> int:
    """Choose one of `count` candidates: each in turn has a bit that is 1 if it is the right one; the last needs
    none.
    """
    return next((turn for turn in range(count - 1) if is_right(turn)), count - 1)


class MatchModel:
    """3.8: predicts a sequence of numbers from what followed the same numbers before."""

    def __init__(self, contexts: Contexts, name: str) -> None:
        self._contexts, self._name = contexts, name
        self._past: list[int] = []
        self._place = -1
        self._run = 0
        self._tables: dict[tuple[int, int], int] = {}
        self._long, self._short = History(8), History(8)

    def read(self, phase: int, otherwise: Callable[[], int]) -> int:
        """Read the next number: a match, or else what `otherwise` reads."""
        count, short, slots = len(self._past), -1, []
        if self._place < 0 or self._run < LONGEST_RUN:
            mixed = phase
            for back in range(1, LONG_MATCH + 1):
                mixed = (mixed * HASH_FACTOR + (self._past[-back] if back <= count else 0)) % 2**32
                if back in (SHORT_MATCH, LONG_MATCH):
                    slots.append((back, mixed >> 19))
            near = [
                place if count - place <= MAX_MATCH_DISTANCE else -1
                for place in (self._tables.get(s, -1) for s in slots)
            ]
            short = near[0]
            if self._place < 0:
                self._place, self._run = near[1], 0
        number = self._match(phase, short)
        if number is None:
            number = otherwise()
        if self._place >= 0:
            self._place += 1
            self._run += 1
        self._tables |= dict.fromkeys(slots, count)
        self._past.append(number)
        return number

    def _match(self, phase: int, short: int) -> int | None:
        proposed = None
        if self._place >= 0:
            proposed = self._past[self._place]
            agreement = 0 if short < 0 else 2 if self._past[short] == proposed else 1
            if self._run >= LONGEST_RUN:
                right = self._contexts.bit(self._name, "sure", phase)
                self._long.add(right)
            else:
                of_run, of_past = (self._run, phase, agreement), (self._long.value, agreement)
                right = self._contexts.mixed((self._name, "long"), of_run, of_past, into=self._long)
            if right:
                return proposed
            self._place = -1
        if short >= 0 and self._past[short] != proposed:
            distance = min(len(self._past) - short, 63)
            inputs = (self._short.value, phase), (distance, phase)
            if self._contexts.mixed((self._name, "short"), *inputs, into=self._short):
                return self._past[short]
        return None


class ByteModel:
    """3.9: predicts a sequence of bytes from what followed the same bytes before."""

    def __init__(self, contexts: Contexts, name: str, primer: bytes = b"") -> None:
        self._contexts, self._name = contexts, name
        self._past: list[int] = []
        self._places: dict[int, int] = {}
        self._place = -1
        self._run = 0
        with contexts.rehearsing(byte >> digit & 1 for byte in primer for digit in reversed(range(8))):
            self.read_bytes(len(primer))

    def read(self) -> int:
        """Read the next byte."""
        past, count = self._past, len(self._past)
        last = int.from_bytes(bytes(past[-4:]), "big")
        slot = hashed(last) >> 20
        if self._place < 0 or count - self._place > MAX_BYTE_DISTANCE:
            place = self._places.get(slot, -1)
            self._place, self._run = place if count - place <= MAX_BYTE_DISTANCE else -1, 0
        self._places[slot] = count
        proposed = 256 + past[self._place] if self._place >= 0 else 0
        run = min(self._run, 15)
        found = 1
        for digit in reversed(range(8)):
            agrees = proposed >> digit + 1 == found
            found = 2 * found + self._contexts.mixed(
                (self._name, 1 + min(run, 3) if agrees else 0),
                (last % 256, found),
                (hashed(last % 2**16 * 256 + found) >> 16,),
                (hashed(last % 2**24 * 256 + found) >> 16,),
                (run, proposed >> digit & 1) if agrees else (),
                of=(self._name,),
            )
        if found == proposed:
            self._place += 1
            self._run += 1
        else:
            self._place = -1
        past.append(found % 256)
        return found % 256

    def read_bytes(self, count: int) -> bytes:
        return bytes(self.read() for _ in range(count))

    def read_text(self) -> str:
        text = bytearray()
        while (byte := self.read()) != END_OF_TEXT:
            text.append(byte)
        try:
            return text.decode("utf-8")
        except UnicodeDecodeError:
            raise CorruptFileError("a text is not UTF-8") from None


def hashed(number: int) -> int:
    return number * HASH_FACTOR % 2**32
