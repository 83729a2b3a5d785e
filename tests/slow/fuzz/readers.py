"""Fuzz readers: ``python -m tests.slow.fuzz.readers MINUTES [READER...]`` spends so many minutes on each.

Each reader runs in a process of its own, with limits of memory and time for each file. It is a finding if a file
raises any error but our own, takes too long or too much memory, or ends the process. The file is kept under
``build/fuzz-readers``, once for each place in the code. The exit code is 1 if there are findings. If a library is
known to crash (USD, Alembic), a file that ends the process is opened again with ``isolate=True``, and is a finding
only if that raises any error but ours, or hangs.
"""

from __future__ import annotations

import faulthandler
import hashlib
import json
import multiprocessing
import multiprocessing.connection
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from pdecodec.errors import PdecodecError
from pdecodec.formats import open_sequence
from tests.slow.fuzz.seeds import READERS, Seed, Target, target

KEPT = Path("build/fuzz-readers")
MAX_MEMORY = 2**31
"""Largest growth of a process's address space: beyond it, a MemoryError is raised, which is a finding."""

MAX_SECONDS = 10
"""Limit of processor time for one file of some kilobytes [s]."""

MAX_WAITED_SECONDS = 300
"""Time after which a process that reports nothing counts as hanging, however busy the machine is [s]."""

MAX_ISOLATED_MEMORY = 6 * 2**30
"""Address space of the process that opens a file in isolation, so that no file exhausts the machine's memory."""

MAX_POSITIONS = 10**6
"""Largest number of positions that are read: a file may declare more than it has."""


class TooSlowError(Exception):
    """A file took more than :data:`MAX_SECONDS`."""


def read_all(folder: Path, seed: Seed, *, isolate: bool = False) -> None:
    """Open and read a file. Any exception but our own errors, and any inconsistent content, is a finding."""
    mesh = folder / "mesh.obj" if "mesh.obj" in seed.files else None
    try:
        with open_sequence(folder / seed.opened, mesh=mesh, skip_unsupported=True, isolate=isolate) as sequence:
            for run in list(sequence.runs)[:4]:
                objects = run.objects
                for item in objects:
                    part = item.connectivity
                    for indices in (part.face_indices, part.line_indices):
                        assert indices.size == 0 or 0 <= indices.min() <= indices.max() < item.vertex_count
                    assert part.face_counts.sum() == part.face_indices.size
                    assert all(attribute.values is not None for attribute in item.attributes)
                assert (np.diff(run.times) > 0).all()
                count = min(run.frame_count, max(1, MAX_POSITIONS // max(1, run.vertex_count)))
                assert run.read_frames(0, count).shape == (count, run.vertex_count, 3)
                run.read_frames(run.frame_count - 1, run.frame_count)
    except PdecodecError:
        pass


def mutant(of: Target, number: int) -> tuple[Seed, bytes]:
    """Return the mutant of a number, which is the same in every run."""
    source = random.Random(number)
    seed = source.choice(of.seeds)
    return seed, of.mutate(source, seed.files[seed.changed])


def write(folder: Path, seed: Seed, changed: bytes) -> None:
    """Write the files of a mutant to a folder."""
    for name, data in seed.files.items():
        (folder / name).write_bytes(changed if name == seed.changed else data)


def _too_slow(number: int, frame: FrameType | None) -> None:
    raise TooSlowError(f"took more than {MAX_SECONDS} s")


def _work(name: str, first: int, deadline: float, wire: Any) -> None:
    """Run mutants until the deadline; send the number of each before it is opened, and the findings."""
    faulthandler.disable()
    warnings.simplefilter("ignore")
    taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + MAX_MEMORY, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, _too_slow)
    of, number = target(name), first
    folder = _new_folder()
    try:
        while time.monotonic() < deadline:
            wire.send(("next", number))
            seed, changed = mutant(of, number)
            write(folder, seed, changed)
            signal.setitimer(signal.ITIMER_PROF, MAX_SECONDS)
            try:
                read_all(folder, seed)
            except (Exception, TooSlowError) as error:
                signal.setitimer(signal.ITIMER_PROF, 0)
                wire.send(("found", number, _place(error), "".join(traceback.format_exception(error))[-4000:]))
            signal.setitimer(signal.ITIMER_PROF, 0)
            number += 1
        wire.send(("done", number))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _new_folder() -> Path:
    shared = Path("/dev/shm")
    return Path(tempfile.mkdtemp(prefix="fuzz-", dir=shared if shared.is_dir() else None))


def _isolated(name: str, number: int) -> BaseException | None:
    """Open a file that has ended a process in isolation; return an error that is not ours, or a hang; None if
    there is neither.
    """
    signal.signal(signal.SIGALRM, _too_slow)
    folder = _new_folder()
    try:
        seed, changed = mutant(target(name), number)
        write(folder, seed, changed)
        signal.alarm(3 * MAX_SECONDS)
        read_all(folder, seed, isolate=True)
    except (Exception, TooSlowError) as error:
        return error
    finally:
        signal.alarm(0)
        shutil.rmtree(folder, ignore_errors=True)
    return None


def _place(error: BaseException) -> str:
    """Return the type of an error, and the last line of our code in its traceback."""
    frames = [one for one in traceback.extract_tb(error.__traceback__) if "site-packages" not in one.filename]
    last = frames[-1] if frames else None
    return f"{type(error).__name__} at {'?' if last is None else f'{Path(last.filename).name}:{last.name}'}"


def _keep(name: str, number: int, place: str, text: str) -> None:
    seed, changed = mutant(target(name), number)
    folder = KEPT / name / hashlib.sha256(place.encode()).hexdigest()[:12]
    if folder.exists():
        return
    folder.mkdir(parents=True)
    write(folder, seed, changed)
    facts = {"reader": name, "number": number, "place": place, "opened": seed.opened, "changed": seed.changed}
    (folder / "finding.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    (folder / "traceback.txt").write_text(text, encoding="utf-8")


def fuzz(name: str, seconds: float, first: int) -> tuple[int, int, dict[str, int]]:
    """Fuzz one reader; return how many files were opened, how many crashed a library, and the findings."""
    deadline, number, found, runs, crashes = time.monotonic() + seconds, first, dict[str, int](), 0, 0
    # No fork: threads that a library has started here would not run in the new process.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__ if __name__ != "__main__" else "tests.slow.fuzz.readers"])

    def note(place: str, text: str) -> None:
        found[place] = found.get(place, 0) + 1
        if found[place] == 1:
            _keep(name, number, place, text)

    while time.monotonic() < deadline:
        wire, theirs = context.Pipe()
        child = context.Process(target=_work, args=(name, number, deadline, theirs), daemon=True)
        child.start()
        theirs.close()
        while True:
            # A library that loops in its own code does not notice the signal.
            if not multiprocessing.connection.wait([wire], timeout=MAX_WAITED_SECONDS):
                child.kill()
                note("hangs in a library", f"took more than {MAX_WAITED_SECONDS} s")
                break
            try:
                kind, number, *rest = wire.recv()
            except EOFError:
                child.join()
                if not target(name).ends_process:
                    note(f"the process ended ({child.exitcode})", f"exit code {child.exitcode}")
                elif (error := _isolated(name, number)) is not None:
                    note(f"isolated: {_place(error)}", "".join(traceback.format_exception(error))[-4000:])
                crashes += 1
                break
            if kind == "found":
                note(*rest)
            elif kind == "next":
                runs += 1
            else:
                break
        child.join()
        number += 1
    return runs, crashes, found


def main() -> int:
    minutes, names = float(sys.argv[1]), sys.argv[2:] or [*READERS]
    resource.setrlimit(resource.RLIMIT_AS, (MAX_ISOLATED_MEMORY, resource.RLIM_INFINITY))
    first = random.SystemRandom().randrange(2**40)
    total = 0
    for name in names:
        runs, crashes, found = fuzz(name, 60 * minutes, first)
        told = f", {crashes} crashes of the library held" if crashes else ""
        print(f"{name}: {runs:,} files opened from number {first} on{told}, {len(found)} findings", flush=True)
        for place, count in found.items():
            print(f"  {count} times: {place}", flush=True)
        total += len(found)
    return 1 if total else 0


if __name__ == "__main__":
    sys.exit(main())
