"""Blender extension: import, play and export pdecodec animations (`.pdeanim`).

`player.py` sets positions frame by frame, `meshes.py` makes meshes and reads them; here are import, export, menus and
the panel. Blender evaluates the annotations of properties, which this file therefore does not postpone.
"""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, IntProperty, PointerProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper
from mathutils import Matrix

import pdecodec

from . import meshes, player

EXTENSION, PATTERN = ".pdeanim", "*.pdeanim"

HAS_MESH = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
"""Types of objects of which Blender makes a mesh."""

SAME_FRAME = 1e-3
"""Largest difference [frames] of a time to the whole frame that it stands for."""


def import_clip(
    scene: bpy.types.Scene,
    collection: bpy.types.Collection,
    path: str,
    *,
    set_frame_range: bool = True,
    use_fields: bool = True,
) -> list[bpy.types.Object]:
    """Add the objects of a file to a collection, and return them; from then on they play.

    Raises
    ------
    pdecodec.PdecodecError
        If the file is missing or damaged.
    """
    clip = player.clip_of(os.path.normpath(path))
    animation, items = clip.animation, list(_objects_of(clip))
    folders = {"": bpy.data.collections.new(Path(path).stem)}
    collection.children.link(folders[""])
    found = []
    for number, item in items:
        above, _, name = item.name.rpartition("/")
        thing = bpy.data.objects.new(name, bpy.data.meshes.new(name))
        thing.matrix_world = Matrix(meshes.space_of(animation))
        if not clip.is_changing:
            meshes.fill(thing.data, item)
            if use_fields:
                meshes.add_fields(thing.data, clip.placed, number)
        settings = thing.pdeanim
        settings.use_fields = use_fields
        settings.object_name, settings.object_number = item.name, number
        # Set without its update, which shows a frame on every object.
        settings["filepath"] = player.relative(path, bpy.data.filepath)
        _folder(folders, above).objects.link(thing)
        found.append(thing)
    if set_frame_range:
        rate = scene.render.fps / scene.render.fps_base
        scene.frame_start = max(0, math.ceil(animation.times[0] * rate - SAME_FRAME))
        scene.frame_end = max(scene.frame_start, math.floor(animation.times[-1] * rate + SAME_FRAME))
        scene.frame_current = min(max(scene.frame_current, scene.frame_start), scene.frame_end)
    # Without the lock, Blender's interface may draw a mesh while a render changes it, and crash.
    scene.render.use_lock_interface = True
    player.show_frame(scene)
    return found


def _objects_of(clip: player.Clip) -> Iterator[tuple[int, pdecodec.MeshObject]]:
    """Yield the objects of a file with their numbers; if faces change, those of all runs, one of each name."""
    if not clip.is_changing:
        yield from enumerate(clip.placed.objects)
        return
    named = {item.name: (number, item) for run in clip.animation.runs for number, item in enumerate(run.meshes)}
    yield from named.values()


def _folder(folders: dict[str, bpy.types.Collection], path: str) -> bpy.types.Collection:
    """Return the collection of a path, ``rig/left``, which is made with those above it if it is missing."""
    if path not in folders:
        above, _, name = path.rpartition("/")
        folders[path] = bpy.data.collections.new(name)
        _folder(folders, above).children.link(folders[path])
    return folders[path]


def shown_clip(
    context: bpy.types.Context,
    things: Sequence[bpy.types.Object],
    frames: Sequence[int],
    progress: Callable[[int], None] = lambda row: None,
) -> pdecodec.MeshSequence:
    """Return what objects look like at whole frames of the scene, with their modifiers, in the scene's space.

    Raises
    ------
    pdecodec.InputError
        If there is no mesh, or the faces of one change.
    """
    scene, before = context.scene, context.scene.frame_current_final
    rate = scene.render.fps / scene.render.fps_base
    objects: list[pdecodec.MeshObject] = []
    rows: list[np.ndarray] = []
    places: list[list[list[float]]] = [[] for _ in things]
    try:
        for frame in frames:
            scene.frame_set(frame)
            graph = context.evaluated_depsgraph_get()
            here = []
            for number, (thing, name) in enumerate(zip(things, _names_of(scene, things), strict=True)):
                there = thing.evaluated_get(graph)
                mesh = there.to_mesh()
                if not rows:
                    slots = [slot.material for slot in there.material_slots]
                    objects.append(meshes.object_of(name, mesh, slots))
                if not meshes.has_faces(mesh, objects[number].connectivity):
                    raise pdecodec.InputError(
                        f"{thing.name!r} has other vertices or faces at frame {frame} than at frame {frames[0]}; "
                        "export frames over which they stay the same"
                    )
                here.append(meshes.read(mesh.vertices, "co", 3, np.float32))
                places[number].append([frame / rate, *np.array(there.matrix_world).T.ravel()])
                there.to_mesh_clear()
            rows.append(np.concatenate(here))
            progress(len(rows))
    finally:
        scene.frame_set(int(before // 1), subframe=before % 1)
    metadata = {"up_axis": "Z", "unit": f"{scene.unit_settings.scale_length:.9g} m"}
    times = np.array(frames) / rate
    # Transforms are applied by the library, which reverses the faces of objects that are mirrored.
    own = [pdecodec.Attribute("transform", "object", np.array(one)) for one in places]
    placed = [
        pdecodec.MeshObject(item.name, item.connectivity, (*item.attributes, transform))
        for item, transform in zip(objects, own, strict=True)
    ]
    clip = pdecodec.ArraySequence(np.stack(rows), objects=placed, times=times, fps=rate, metadata=metadata)
    return pdecodec.bake_transforms(clip)


def _names_of(scene: bpy.types.Scene, things: Sequence[bpy.types.Object]) -> list[str]:
    """Return the objects' names below those of their collections, without the collections that hold them all."""
    paths = {}
    for above, collection in _collections(scene.collection, ()):
        for thing in collection.objects:
            paths.setdefault(thing, above)
    found = [paths.get(thing, ()) for thing in things]
    # The first and the last path in order share what all share.
    shared = next((n for n, (a, b) in enumerate(zip(min(found), max(found), strict=False)) if a != b), len(min(found)))
    return ["/".join((*above[shared:], thing.name)) for above, thing in zip(found, things, strict=True)]


def _collections(top: Any, above: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    yield above, top
    for child in top.children:
        yield from _collections(child, (*above, child.name))


class ImportAnimation(bpy.types.Operator, ImportHelper):
    """Import a pdecodec animation, which is read from its file while it plays."""

    bl_idname = "import_scene.pdeanim"
    bl_label = "Import pdecodec animation"
    bl_options = {"UNDO"}

    filename_ext = EXTENSION
    filter_glob: StringProperty(default=PATTERN, options={"HIDDEN"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    set_frame_range: BoolProperty(
        name="Set Frame Range", default=True, description="Let the scene begin and end with the clip"
    )
    use_fields: BoolProperty(
        name="Fields", default=True, description="Show values that change in time, such as stress, as attributes"
    )

    def execute(self, context):
        names = [one.name for one in self.files if one.name]
        for path in [os.path.join(self.directory, name) for name in names] or [self.filepath]:
            try:
                options = {"set_frame_range": self.set_frame_range, "use_fields": self.use_fields}
                found = import_clip(context.scene, context.collection, path, **options)
            except (pdecodec.PdecodecError, OSError) as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            self.report({"INFO"}, f"{os.path.basename(path)}: {facts_of(found[0])}")
            fields = player.clip_of(player.path_of(found[0])).animation.runs[0].fields
            hidden = ", ".join(field.name for field in fields if not meshes.is_shown(field))
            if self.use_fields and hidden:
                self.report({"WARNING"}, f"{os.path.basename(path)}: meshes cannot show the fields {hidden}")
        return {"FINISHED"}

    def invoke(self, context, event):
        # Files that were dropped are named already.
        return self.execute(context) if self.directory and self.files else super().invoke(context, event)


class ExportAnimation(bpy.types.Operator, ExportHelper):
    """Export the selected objects as a pdecodec animation, and report its size and error."""

    bl_idname = "export_scene.pdeanim"
    bl_label = "Export pdecodec animation"

    filename_ext = EXTENSION
    filter_glob: StringProperty(default=PATTERN, options={"HIDDEN"})
    tolerance: FloatProperty(
        name="Tolerance", default=1e-3, min=1e-7, max=1, precision=6, subtype="FACTOR",
        description="Largest error of a vertex, as a fraction of the diagonal of the bounding box at the first frame",
    )  # fmt: skip
    frame_start: IntProperty(name="Start", description="First frame", min=0)
    frame_end: IntProperty(name="End", description="Last frame", default=250, min=0)

    def invoke(self, context, event):
        self.frame_start, self.frame_end = context.scene.frame_start, context.scene.frame_end
        return super().invoke(context, event)

    def execute(self, context):
        things = [thing for thing in context.selected_objects if thing.type in HAS_MESH]
        if not things:
            self.report({"ERROR"}, "no mesh is selected; select the objects to export")
            return {"CANCELLED"}
        frames, window = range(self.frame_start, max(self.frame_start, self.frame_end) + 1), context.window_manager
        window.progress_begin(0, len(frames))
        try:
            clip = shown_clip(context, things, frames, window.progress_update)
            report = pdecodec.encode(clip, self.filepath, tolerance=self.tolerance, overwrite=True)
        except (pdecodec.PdecodecError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            window.progress_end()
        size = sum(report.sections.values())
        self.report(
            {"INFO"},
            f"{os.path.basename(self.filepath)}: {report.raw_bytes / 1e6:.3g} MB of positions are {size / 1e3:,.1f} "
            f"kB, 1/{report.raw_bytes / size:.0f}; largest error {report.max_error:.3g}, bound {report.bound:.3g}",
        )
        for warning in report.warnings:
            self.report({"WARNING"}, warning)
        return {"FINISHED"}


def facts_of(thing: bpy.types.Object) -> str:
    """Return in a line what an object's file holds."""
    animation = player.clip_of(player.path_of(thing)).animation
    size = os.path.getsize(player.path_of(thing))
    return f"{len(animation.times)} frames in {animation.times[-1] - animation.times[0]:.3g} s, {size / 1e3:,.1f} kB"


def _changed(settings, context):
    player.show_again()


class AnimationSettings(bpy.types.PropertyGroup):
    """What an object shows, and when."""

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"LIBRARY_EDITABLE"}, update=_changed)
    object_name: StringProperty(name="Object", description="Its name in the file", update=_changed)
    object_number: IntProperty(description="Its number in the file, which tells objects of one name apart")
    frame_offset: FloatProperty(
        name="Frame Offset", description="Frame of the scene at which time 0 of the file is shown", update=_changed
    )
    speed: FloatProperty(
        name="Speed", default=1, description="Seconds of the clip in one second of the scene", update=_changed
    )
    loop: BoolProperty(name="Loop", description="Repeat the clip before and after its frames", update=_changed)
    use_fields: BoolProperty(default=True, description="Add the fields of meshes whose faces change")


class AnimationPanel(bpy.types.Panel):
    """The settings of an object that shows a file, and what is wrong with the file."""

    bl_idname = "OBJECT_PT_pdeanim"
    bl_label = "pdecodec Animation"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "object"

    @classmethod
    def poll(cls, context):
        return context.object is not None and bool(context.object.pdeanim.filepath)

    def draw(self, context):
        layout, thing = self.layout, context.object
        layout.use_property_split = True
        for name in ("filepath", "object_name", "frame_offset", "speed", "loop"):
            layout.prop(thing.pdeanim, name)
        message = player.message_of(thing)
        if message:
            row = layout.row()
            row.alert = True
            row.label(text=message, icon="ERROR")
        else:
            layout.label(text=facts_of(thing), icon="INFO")


class AnimationDrop(bpy.types.FileHandler):
    """Imports files that are dropped on the 3D view or the outliner."""

    bl_idname = "IO_FH_pdeanim"
    bl_label = "pdecodec animation"
    bl_import_operator = ImportAnimation.bl_idname
    bl_file_extensions = EXTENSION

    @classmethod
    def poll_drop(cls, context):
        return context.area is not None and context.area.type in {"VIEW_3D", "OUTLINER"}


CLASSES = (AnimationSettings, ImportAnimation, ExportAnimation, AnimationPanel, AnimationDrop)


def _draw_import(menu, context):
    menu.layout.operator(ImportAnimation.bl_idname, text="pdecodec animation (.pdeanim)")


def _draw_export(menu, context):
    menu.layout.operator(ExportAnimation.bl_idname, text="pdecodec animation (.pdeanim)")


def register() -> None:
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Object.pdeanim = PointerProperty(type=AnimationSettings, override={"LIBRARY_OVERRIDABLE"})
    bpy.types.TOPBAR_MT_file_import.append(_draw_import)
    bpy.types.TOPBAR_MT_file_export.append(_draw_export)
    player.register()


def unregister() -> None:
    player.unregister()
    bpy.types.TOPBAR_MT_file_export.remove(_draw_export)
    bpy.types.TOPBAR_MT_file_import.remove(_draw_import)
    del bpy.types.Object.pdeanim
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)
