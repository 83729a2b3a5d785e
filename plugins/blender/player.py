"""Play `.pdeanim` files: after each change of frame, write positions into the meshes that show a file.

Begin with :func:`show_frame`. Files stay open from frame to frame; a file that was replaced is opened again. What is
wrong with an object's file is in :func:`message_of`, for the panel.
"""

from __future__ import annotations

import os
from itertools import accumulate
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

import pdecodec

from . import meshes

POSITIONS, VELOCITIES = " positions", " velocities"
"""Names of values that are no field; no field's name begins with a space."""

RUN = "pdeanim_run"
"""Property of a mesh whose faces change: the run of frames whose faces it has."""


class Clip:
    """An open file in the scene's space, with its values at the time last asked for, which all its objects ask for."""

    def __init__(self, path: str) -> None:
        self.animation = pdecodec.open(path)
        self.placed: Any = pdecodec.bake_transforms(self.animation)
        self.is_changing = len(self.placed.runs) > 1
        self._starts: dict[int, list[int]] = {}
        self._values: dict[str, np.ndarray] = {}
        self._time = float("nan")

    def place_of(self, name: str, number: int, time: float) -> tuple[int, slice]:
        """Return an object's number at a time and its rows of vertices; -1 and no rows if there is none of its name.

        Several objects may have one name; `number` then says which of them.
        """
        items, run = self.placed.run_at(time).objects, self.placed.run_number_at(time)
        if not (number < len(items) and items[number].name == name):
            number = next((place for place, item in enumerate(items) if item.name == name), -1)
        if run not in self._starts:
            self._starts[run] = [0, *accumulate(item.vertex_count for item in items)]
        starts = self._starts[run]
        return number, slice(starts[number], starts[number + 1]) if number >= 0 else slice(0, 0)

    def values(self, name: str, time: float) -> np.ndarray:
        """Return positions, velocities or a field at a time [s]; outside the clip, of its first or last frame."""
        if time != self._time:
            self._values, self._time = {}, time
        if name not in self._values:
            run = self.placed.run_at(time)
            is_motion = name in (POSITIONS, VELOCITIES)
            self._values[name] = getattr(run, name.strip())(time) if is_motion else run.field(name, time)
        return self._values[name]


_clips: dict[str, tuple[tuple[int, int] | None, Clip | str]] = {}
"""By path: the stamp of the file, and the open file or why it could not be opened."""

_messages: dict[int, str] = {}
"""What is wrong with an object's file, by the object's identifier in this session."""


def clip_of(path: str) -> Clip:
    """Return the open file at an absolute path; a file that stays as it is, is opened, or fails, once.

    Raises
    ------
    pdecodec.InputError
        If the file is missing or cannot be opened.
    """
    try:
        found = os.stat(path)
        stamp = (found.st_mtime_ns, found.st_size)
    except OSError:
        stamp = None
    known, clip = _clips.get(path, ((0, 0), ""))
    if path not in _clips or known != stamp:
        if isinstance(clip, Clip):
            clip.animation.close()
        try:
            clip = f"{path} is missing; choose the file again" if stamp is None else Clip(path)
        except (pdecodec.PdecodecError, OSError) as error:
            clip = str(error)
        _clips[path] = stamp, clip
    if isinstance(clip, str):
        raise pdecodec.InputError(clip)
    return clip


def close_all() -> None:
    """Close all files."""
    for _, clip in _clips.values():
        if isinstance(clip, Clip):
            clip.animation.close()
    _clips.clear()
    _messages.clear()


def path_of(thing: bpy.types.Object) -> str:
    """Return the path of an object's file; after ``//`` it counts from the .blend file that holds the object."""
    return os.path.normpath(bpy.path.abspath(thing.pdeanim.filepath, library=thing.library))


def relative(path: str, blend: str) -> str:
    """Return a path as seen from a .blend file, after ``//``; the path itself if they have no drive in common."""
    try:
        return bpy.path.relpath(path, start=os.path.dirname(blend)) if blend else path
    except ValueError:
        return path


def message_of(thing: bpy.types.Object) -> str:
    """Return what is wrong with an object's file; empty if nothing is."""
    return _messages.get(thing.session_uid, "")


def time_of(settings: Any, animation: pdecodec.Animation, scene: bpy.types.Scene) -> float:
    """Return the time in a file [s] that the scene's frame shows; outside the clip, it stands still.

    Frame `frame_offset` is time 0, as in Blender's own caches. Speed counts from the first frame of the clip, which
    stays where it is.
    """
    first, last = float(animation.times[0]), float(animation.times[-1])
    seconds = (scene.frame_current_final - settings.frame_offset) * scene.render.fps_base / scene.render.fps
    passed = (seconds - first) * settings.speed
    if settings.loop and last > first:
        passed %= last - first
    return first + passed


def show(thing: bpy.types.Object, settings: Any, scene: bpy.types.Scene) -> None:
    """Write into an object's mesh what its file shows at the scene's frame; `settings` have their animated values.

    Raises
    ------
    pdecodec.PdecodecError
        If the file cannot be decoded, or is not the one that the mesh was made from.
    """
    clip = clip_of(path_of(thing))
    time = time_of(settings, clip.animation, scene)
    run, mesh = clip.placed.run_at(time), thing.data
    number, rows = clip.place_of(thing.pdeanim.object_name, thing.pdeanim.object_number, time)
    if clip.is_changing and mesh.get(RUN) != clip.placed.run_number_at(time):
        meshes.fill(mesh, run.objects[number] if number >= 0 else None)
        if thing.pdeanim.use_fields:
            meshes.add_fields(mesh, run, number)
        mesh[RUN] = clip.placed.run_number_at(time)
    if rows.stop - rows.start != len(mesh.vertices):
        raise pdecodec.InputError(
            f"{path_of(thing)} has {rows.stop - rows.start} vertices in object {thing.pdeanim.object_name!r}, the mesh "
            f"has {len(mesh.vertices)}; import the file again"
        )
    if number < 0:
        return
    points, rates = clip.values(POSITIONS, time)[rows], None
    if scene.render.use_motion_blur or meshes.VELOCITY in mesh.attributes:
        rates = clip.values(VELOCITIES, time)[rows]
    mesh.vertices.foreach_set("co", np.ascontiguousarray(points).reshape(-1))
    if rates is not None:
        meshes.write_values(mesh, meshes.VELOCITY, "vertex", rates * np.float32(settings.speed))
    for name, field in meshes.fields_in(mesh, run, number):
        meshes.write_values(mesh, name, field.domain, run.field(field.name, time, object=number))
    mesh.update()


@persistent
def show_frame(scene: bpy.types.Scene, graph: bpy.types.Depsgraph | None = None) -> None:
    """Show the scene's frame on all objects that show a file; keep what is wrong with one for the panel.

    Blender calls it after it has evaluated a frame, also a fraction of one while it renders motion blur, and then
    evaluates what it changed.
    """
    for thing in scene.objects:
        if thing.type != "MESH" or not thing.pdeanim.filepath or thing.mode == "EDIT":
            continue
        is_animated = graph is not None and thing.animation_data is not None
        said = ""
        try:
            show(thing, thing.evaluated_get(graph).pdeanim if is_animated else thing.pdeanim, scene)
        except (pdecodec.PdecodecError, OSError) as error:
            said = str(error)
        if said != message_of(thing):
            _messages[thing.session_uid] = said
            for area in (area for window in bpy.context.window_manager.windows for area in window.screen.areas):
                area.tag_redraw()


@persistent
def show_again(*_: Any) -> None:
    """Show the current frame of every scene, after a step was undone or a setting changed."""
    for scene in bpy.data.scenes:
        show_frame(scene)


@persistent
def show_opened(*_: Any) -> None:
    """Show what a .blend file that was opened refers to, and say which files are missing."""
    close_all()
    show_again()
    wrong = sorted({message for message in _messages.values() if message})
    if wrong and not bpy.app.background:
        bpy.context.window_manager.popup_menu(
            lambda menu, _: [menu.layout.label(text=one) for one in wrong], title="pdecodec", icon="ERROR"
        )


_paths_before_saving: dict[int, str] = {}
"""Relative paths of objects, by their identifiers, while the .blend file is being saved."""


@persistent
def point_from_new_folder(target: str) -> None:
    """Before a .blend file is saved elsewhere, change relative paths so that they lead to the same files from there."""
    _paths_before_saving.clear()
    for thing in bpy.data.objects:
        if thing.library is None and thing.pdeanim.filepath.startswith("//") and target:
            _paths_before_saving[thing.session_uid] = thing.pdeanim.filepath
            # Set without its update, which shows a frame on every object.
            thing.pdeanim["filepath"] = relative(path_of(thing), target)


@persistent
def point_from_open_file(target: str) -> None:
    """After only a copy was saved, change the paths back."""
    if target != bpy.data.filepath:
        for thing in bpy.data.objects:
            if thing.session_uid in _paths_before_saving:
                thing.pdeanim["filepath"] = _paths_before_saving[thing.session_uid]


HANDLERS = {
    "frame_change_post": show_frame,
    "load_post": show_opened,
    "undo_post": show_again,
    "redo_post": show_again,
    "save_pre": point_from_new_folder,
    "save_post": point_from_open_file,
    "save_post_fail": point_from_open_file,
}
"""Functions by the lists of :mod:`bpy.app.handlers` that they are in."""


def register() -> None:
    """Have Blender call the handlers."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Undo :func:`register`, and close all files."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    close_all()
