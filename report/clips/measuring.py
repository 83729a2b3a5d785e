"""Measure a clip: encode, decode the bytes again, compare; only decoded bytes count.

Profiles use every core and are measured one after the other. Baselines use one core each; the plan says how many run
at a time, in worker processes. Measurements kept from an earlier run are not repeated. Times are medians, because
some runs are always disturbed.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, get_args

import numpy as np

from pdecodec.codec.container import CONSTANT_SECTIONS
from pdecodec.codec.decoder import Animation
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EffortName, Profile
from pdecodec.errors import InputError
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.metrics import Distortion, frame_scale, measure_distortion
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import ArraySequence, Progress
from pdecodec.mesh.surface_metrics import measure_surface
from pdecodec.report.clips.baseline import Baseline, UnreachableError
from pdecodec.report.clips.measurement import KeptMeasurements, Measurement, clip_digest, codec_version, measurement_key
from pdecodec.report.clips.ratesearch import RateCurve
from pdecodec.system.workers import Worker, WorkerError, call_workers

TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)
"""Tolerances that are measured, two per decade: from objects in the background to archives."""

PROFILES: tuple[Profile, ...] = ("auto", "paper")

JOBS = 2
"""Number of baselines that are measured at a time."""

WARM_UP_FRAMES = 8
"""Frames encoded and decoded before timing, so that loading libraries is not timed."""

RUNS = 5
"""Timed runs; their median counts."""

COPY_RUNS = 15
"""Timed copies; copies are short, so one disturbance weighs much."""

RANDOM_FRAMES = 100
"""Number of random times at which single frames are decoded."""


@dataclass(frozen=True, kw_only=True)
class ReportPlan:
    """What to measure.

    Tolerances from coarse to fine, profiles, baselines that can run here, baselines that also code faces (for clips
    whose connectivity changes), the effort of profile auto, and the number of baselines measured at a time.
    """

    tolerances: tuple[float, ...] = TOLERANCES
    profiles: tuple[Profile, ...] = PROFILES
    baselines: tuple[Baseline, ...] = ()
    face_baselines: tuple[Baseline, ...] = ()
    effort: EffortName = "default"
    jobs: int = JOBS

    @property
    def points(self) -> int:
        """Number of measurements per clip."""
        return (len(self.profiles) + len(self.baselines)) * len(self.tolerances)


def measure_clip(
    clip: str, sequence: ArraySequence, plan: ReportPlan, kept: KeptMeasurements, *, progress: Progress | None = None
) -> list[Measurement]:
    """Measure a clip in the order of the plan: profiles, then baselines, each from coarse to fine.

    Kept measurements are not repeated; new ones are kept at once. Raises InputError if a process that measures
    baselines ended, as happens when memory runs out.
    """
    digest = clip_digest(sequence)
    found: dict[tuple[str, float], Measurement] = {}

    def add(point: Measurement, version: str = "") -> None:
        if version:
            kept.keep(measurement_key(digest, version, point.tolerance), point)
        found[point.coder, point.tolerance] = point
        if progress is not None:
            progress(len(found), plan.points, f"{clip}: {point.coder}")

    def missing(version: str) -> list[float]:
        """Return the tolerances without a kept measurement, and add the kept measurements of the others."""
        there = {item: kept.find(measurement_key(digest, version, item), clip) for item in plan.tolerances}
        for point in there.values():
            if point is not None:
                add(point)
        return [tolerance for tolerance, point in there.items() if point is None]

    for profile in plan.profiles:
        version = _profile_version(profile, plan.effort)
        absent = missing(version)
        if absent:
            warm_up(sequence, profile=profile, tolerances=absent, effort=plan.effort)
        for tolerance in absent:
            add(measure_profile(clip, sequence, profile=profile, tolerance=tolerance, effort=plan.effort), version)
    constant_size = found[plan.profiles[0], plan.tolerances[0]].constant_size
    tasks = {baseline: absent for baseline in plan.baselines if (absent := missing(baseline.version()))}
    for baseline, points in _measure_baselines(clip, sequence, tasks, jobs=plan.jobs):
        for point in points:
            add(point, baseline.version())
    coders = [*plan.profiles, *(baseline.name for baseline in plan.baselines)]
    every = [found[coder, tolerance] for coder in coders for tolerance in plan.tolerances]
    return [point if point.kind == "profile" else replace(point, constant_size=constant_size) for point in every]


def measure_efforts(
    clip: str, sequence: ArraySequence, plan: ReportPlan, kept: KeptMeasurements, *, tolerance: float
) -> Iterator[Measurement]:
    """Measure profile auto with the efforts that are not the plan's, each as a coder of its own; none if auto is not
    measured.

    Kept measurements are not repeated; new ones are kept at once.
    """
    digest = clip_digest(sequence)
    for effort in get_args(EffortName) if "auto" in plan.profiles else ():
        if effort == plan.effort:
            continue
        key = measurement_key(digest, _profile_version("auto", effort), tolerance)
        point = kept.find(key, clip)
        if point is None:
            warm_up(sequence, profile="auto", tolerances=(tolerance,), effort=effort)
            point = measure_profile(clip, sequence, profile="auto", tolerance=tolerance, effort=effort)
            kept.keep(key, point)
        yield replace(point, coder=f"auto, {effort}")


def _profile_version(profile: Profile, effort: EffortName) -> str:
    return f"{codec_version()} {profile} {effort}"


def measure_profile(
    clip: str,
    sequence: ArraySequence,
    *,
    profile: Profile,
    tolerance: float,
    effort: EffortName = "default",
) -> Measurement:
    """Encode with a profile, decode the bytes, compare.

    Raises
    ------
    AssertionError
        If decoding changed the connectivity.
    """
    started = time.perf_counter()
    report = encode(sequence, profile=profile, tolerance=tolerance, effort=effort, scene="drop")
    encode_seconds = time.perf_counter() - started
    data = report.data or b""
    decoded = np.empty_like(sequence.points)

    def decode() -> None:
        with open_animation(data) as animation:
            animation.sample(animation.times, out=decoded)

    decode_seconds = median_seconds(decode)
    scale = frame_scale(sequence.points[0])
    with open_animation(data) as animation:
        if not animation.connectivity.same_as(sequence.connectivity):
            raise AssertionError(f"{clip}: connectivity came back otherwise")
        found = measure_distortion(sequence, animation, scale=scale, limit=tolerance * scale)
        random_seconds = random_frame_seconds(animation)
    constant = sum(size for section, size in report.sections.items() if section in CONSTANT_SECTIONS)
    return Measurement(
        clip=clip,
        coder=profile,
        kind="profile",
        tolerance=tolerance,
        frames=sequence.frame_count,
        vertices=sequence.vertex_count,
        size=report.file_bytes - constant,
        constant_size=constant,
        within=found.within,
        **_errors(found, scale),
        **asdict(measure_surface(sequence.points, decoded, sequence.connectivity, scale)),
        encode_seconds=encode_seconds,
        decode_seconds=decode_seconds,
        copy_seconds=copy_seconds(decoded),
        random_seconds=random_seconds,
        coefficients=report.coefficients,
        sections=report.sections,
        summary=report.summary,
    )


def measure_baseline(
    clip: str, sequence: ArraySequence, baseline: Baseline, tolerances: Sequence[float]
) -> Iterator[Measurement]:
    """Search the fewest bytes with which a baseline keeps each tolerance; return measurements in their order."""
    scale = frame_scale(sequence.points[0])
    copied = copy_seconds(sequence.points)
    curve = RateCurve(baseline, sequence.points, sequence.connectivity)
    for tolerance in tolerances:
        empty = Measurement(
            clip=clip,
            coder=baseline.name,
            kind="baseline",
            published=baseline.published,
            tolerance=tolerance,
            frames=sequence.frame_count,
            vertices=sequence.vertex_count,
        )
        try:
            result = curve.reach(tolerance * scale)
        except UnreachableError as refusal:
            yield replace(empty, refusal=str(refusal))
            continue
        yield replace(
            empty,
            size=result.size,
            # The search accepts only results that are within the bound everywhere.
            within=1.0,
            **_errors(result.distortion, scale),
            **asdict(measure_surface(sequence.points, curve.decode(result), sequence.connectivity, scale)),
            encode_seconds=result.encode_seconds,
            decode_seconds=result.decode_seconds,
            copy_seconds=copied,
        )


def _errors(found: Distortion, scale: float) -> dict[str, Any]:
    """Return the error fields of a measurement, with lengths over the diagonal `scale`."""
    return {
        "max_error": found.max_error / scale,
        "rms_error": found.rms_error / scale,
        "p99_error": found.p99_error / scale,
        "kg_error": found.to_dict()["kg_error"],
    }


def warm_up(sequence: ArraySequence, *, profile: Profile, tolerances: Sequence[float], effort: EffortName) -> None:
    """Encode and decode a few frames, to load everything that is loaded at first use."""
    start = FrameSelection(sequence, range(min(WARM_UP_FRAMES, sequence.frame_count)))
    for tolerance in {min(tolerances), max(tolerances)}:
        report = encode(start, profile=profile, tolerance=tolerance, effort=effort, scene="drop")
        with open_animation(report.data or b"") as animation:
            animation.read_frames(0, animation.frame_count)


def _measure_baselines(
    clip: str, sequence: ArraySequence, tasks: Mapping[Baseline, list[float]], *, jobs: int
) -> Iterator[tuple[Baseline, list[Measurement]]]:
    """Yield baselines with their measurements, each as soon as it is done."""
    if jobs == 1 or len(tasks) < 2:
        for baseline, tolerances in tasks.items():
            yield baseline, _measure_one(clip, sequence, baseline, tolerances)
        return
    workers = [Worker() for _ in range(min(jobs, len(tasks)))]

    def measure(worker: Worker, task: tuple[Baseline, list[float]]) -> list[Measurement]:
        points: list[Measurement] = worker.call(_measure_one, clip, sequence, *task)
        return points

    for (baseline, _), found in call_workers(list(tasks.items()), measure, workers):
        if isinstance(found, WorkerError):
            raise InputError(
                f"{clip}: a process that measured other methods ended, as happens where memory runs out; what was "
                "measured is kept: run it again without baselines",
                code="worker-ended",
                setting="jobs",
                value=1,
                purpose="to take less memory",
            ) from found
        if isinstance(found, Exception):
            raise found
        yield baseline, found


def _measure_one(
    clip: str, sequence: ArraySequence, baseline: Baseline, tolerances: Sequence[float]
) -> list[Measurement]:
    start = FrameSelection(sequence, range(min(WARM_UP_FRAMES, sequence.frame_count))).to_array()
    for _ in measure_baseline(clip, start, baseline, tolerances[:1]):
        pass
    return list(measure_baseline(clip, sequence, baseline, tolerances))


def median_seconds(work: Callable[[], object], *, runs: int = RUNS) -> float:
    """Return the median time of some runs, after one that fills caches and does not count."""
    work()
    return statistics.median(_seconds(work) for _ in range(runs))


def copy_seconds(points: Float32Array) -> float:
    """Return the median time of `np.copyto` of positions, the reference for decoding."""
    return median_seconds(partial(np.copyto, np.empty_like(points), points), runs=COPY_RUNS)


def random_frame_seconds(animation: Animation) -> float:
    """Return the median time of one frame at a random time of an open animation; all runs use the same times."""
    times = np.random.default_rng(0).uniform(animation.times[0], animation.times[-1], RANDOM_FRAMES)
    animation.positions(float(times[0]))
    return statistics.median(_seconds(partial(animation.positions, float(at))) for at in times)


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started
