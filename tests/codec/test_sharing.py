"""An open animation in several threads and processes at the same time: always the same bits."""

from __future__ import annotations

import copy
import io
import multiprocessing
import os
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import BinaryIO

import numpy as np
import pytest

from pdecodec import Animation, ArraySequence, DecodeLimits, InputError, PaperSettings, encode, open_animation

THREADS = 16

FORKS = "fork" in multiprocessing.get_all_start_methods()


def clip() -> ArraySequence:
    return ArraySequence(np.random.default_rng(4).normal(size=(60, 30, 3)).astype(np.float32))


FORGETFUL = DecodeLimits(max_kept=1)
"""Limits with which every call has to read and decode again."""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("sharing") / "clip.pdeanim"
    encode(clip(), target, profile="paper", paper=PaperSettings(segment_frames=4))
    return target


@pytest.fixture(scope="module")
def expected(path: Path) -> np.ndarray:
    with open_animation(path) as animation:
        return animation.sample(animation.times)


@pytest.fixture(params=["path", "bytes", "plain file", "file in memory"])
def shared(request: pytest.FixtureRequest, path: Path) -> Iterator[Animation]:
    opened: dict[str, Callable[[], Path | bytes | BinaryIO]] = {
        "path": lambda: path,
        "bytes": path.read_bytes,
        "plain file": lambda: path.open("rb"),
        "file in memory": lambda: io.BytesIO(path.read_bytes()),
    }
    source = opened[request.param]()
    with open_animation(source, limits=FORGETFUL) as animation:
        yield animation
    if not isinstance(source, Path | bytes):
        assert not source.closed
        source.close()


def at_frame(animation: Animation, frame: int) -> np.ndarray:
    return animation.positions(animation.times[frame])


def test_many_threads_see_the_same_bits(shared: Animation, expected: np.ndarray) -> None:
    frames = np.random.default_rng(1).integers(0, 60, 25 * THREADS)
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(partial(at_frame, shared), frames))
    assert np.array_equal(found, expected[frames])


def test_a_plain_file_may_be_moved_by_others_while_it_is_decoded(path: Path, expected: np.ndarray) -> None:
    done = Event()
    with path.open("rb") as file, open_animation(file, limits=FORGETFUL) as animation:

        def move() -> None:
            while not done.is_set():
                file.seek(3)

        mover = Thread(target=move)
        mover.start()
        try:
            found = [at_frame(animation, frame) for frame in range(60)]
        finally:
            done.set()
            mover.join()
    assert np.array_equal(found, expected)


@pytest.mark.skipif(not FORKS, reason="no process is copied here")
def test_forked_children_read_while_their_parent_reads(path: Path, expected: np.ndarray) -> None:
    frames = list(range(60)) * 4
    with open_animation(path, limits=FORGETFUL) as animation:
        children = []
        for child in range(4):
            number = os.fork()
            if number == 0:
                same = all(np.array_equal(at_frame(animation, frame), expected[frame]) for frame in frames[child:])
                os._exit(0 if same else 1)
            children.append(number)
        same = all(np.array_equal(at_frame(animation, frame), expected[frame]) for frame in frames)
        assert [os.waitpid(number, 0)[1] for number in children] == [0] * 4
    assert same


@pytest.mark.skipif(not FORKS, reason="no process is copied here")
def test_a_fork_while_other_threads_decode_leaves_a_child_that_decodes(shared: Animation, expected: np.ndarray) -> None:
    done = Event()

    def work() -> None:
        while not done.is_set():
            shared.sample(shared.times)

    others = [Thread(target=work) for _ in range(4)]
    for other in others:
        other.start()
    ends = []
    try:
        for _ in range(8):
            if (number := os.fork()) == 0:
                ended = Thread(target=lambda: os._exit(0 if np.array_equal(at_frame(shared, 7), expected[7]) else 1))
                ended.start()
                ended.join(20)
                os._exit(2)  # reached if it waits for a lock whose owner the fork did not copy
            ends.append(os.waitpid(number, 0)[1])
    finally:
        done.set()
        for other in others:
            other.join()
    assert ends == [0] * 8


@pytest.mark.parametrize(
    ("method", "source"),
    [*((method, "path") for method in multiprocessing.get_all_start_methods()), ("spawn", "bytes")],
)
def test_pools_of_every_start_method_take_an_open_animation(
    method: str, source: str, path: Path, expected: np.ndarray
) -> None:
    with open_animation(path if source == "path" else path.read_bytes()) as animation:
        assert np.array_equal(at_frame(animation, 3), expected[3])  # the parent has decoded in threads before
        with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as pool:
            found = list(pool.map(at_frame, [animation] * 8, range(0, 56, 7)))
    assert np.array_equal(found, expected[0:56:7])


def encoded_size(seed: int) -> int:
    points = clip().points[:20] + np.float32(seed)
    return encode(ArraySequence(points), effort="fast").file_bytes


@pytest.mark.parametrize("method", multiprocessing.get_all_start_methods())
def test_children_encode_after_their_parent_did(method: str) -> None:
    sizes = [encoded_size(seed) for seed in (0, 1)]
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as pool:
        assert list(pool.map(encoded_size, (0, 1))) == sizes


def test_an_animation_is_pickled_by_its_path_from_whatever_folder(
    path: Path, expected: np.ndarray, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(path.parent)
    with open_animation(path.name) as animation:
        data = pickle.dumps(animation)
        assert len(data) < 500
        monkeypatch.chdir(tmp_path)
        with pickle.loads(data) as again, copy.copy(animation) as another:
            assert np.array_equal(again.sample(again.times), expected)
            assert np.array_equal(another.sample(another.times), expected)
    with path.open("rb") as file, open_animation(file) as animation, pytest.raises(InputError, match="by its path"):
        pickle.dumps(animation)


def test_a_closed_animation_refuses_calls_and_keeps_its_objects(shared: Animation, expected: np.ndarray) -> None:
    objects = shared.objects
    shared.close()
    shared.close()
    calls: list[Callable[[], object]] = [
        lambda: shared.positions(0.0),
        lambda: shared.velocities(0.0),
        shared.info,
        shared.verify,
        lambda: shared.coefficients(0),
        lambda: shared.sections,
        lambda: shared.metadata,
    ]
    for call in calls:
        with pytest.raises(InputError, match="is closed; open it again"):
            call()
    assert shared.objects is objects
    assert shared.frame_count == 60


def test_a_file_that_its_owner_closed_is_reported_as_closed(path: Path) -> None:
    with io.BytesIO(path.read_bytes()) as file:
        animation = open_animation(file)
    with pytest.raises(InputError, match="its file was closed"):
        animation.positions(0.0)


def test_calls_under_way_end_well_when_another_thread_closes(path: Path, expected: np.ndarray) -> None:
    for _ in range(10):
        animation = open_animation(path, limits=FORGETFUL)

        def read(animation: Animation = animation) -> None:
            for _ in range(1000):
                assert np.array_equal(animation.sample(animation.times), expected)

        with ThreadPoolExecutor(4) as pool:
            readers = [pool.submit(read) for _ in range(4)]
            animation.close()
            for reader in readers:
                with pytest.raises(InputError, match="is closed; open it again"):
                    reader.result()


@pytest.mark.skipif(os.name != "posix", reason="there are no pipes with names")
def test_a_pipe_is_refused(path: Path) -> None:
    reading, writing = os.pipe()
    with (
        os.fdopen(reading, "rb") as file,
        os.fdopen(writing, "wb"),
        pytest.raises(InputError, match="is not a regular file"),
    ):
        open_animation(file)
