"""The bundled scenes by name."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pdecodec.errors import SettingsError
from pdecodec.xpbd.options import ClothOptions, CubeRopeOptions, FlagOptions, JellyOptions, OptionInfo, SceneOptions

if TYPE_CHECKING:
    from pdecodec.xpbd.simulation import Scene


@dataclass(frozen=True, kw_only=True)
class SceneEntry:
    """A scene that can be built.

    Parameters
    ----------
    description : str
        One sentence.
    options_type : type of SceneOptions
    module : str
        Where its ``build(options)`` is; imported when the scene is built, since it brings numba along.
    """

    description: str
    options_type: type[SceneOptions]
    module: str

    @property
    def options(self) -> tuple[OptionInfo, ...]:
        """Its options, for help pages."""
        return self.options_type.infos()


SCENES = {
    "cube-rope": SceneEntry(
        description="A twisted rope of square section, held at its ends, that swings and is shaken.",
        options_type=CubeRopeOptions,
        module="pdecodec.xpbd.scene_cube_rope",
    ),
    "cloth": SceneEntry(
        description="A cloth that hangs by two corners, or falls on a sphere and the ground.",
        options_type=ClothOptions,
        module="pdecodec.xpbd.scene_cloth",
    ),
    "flag": SceneEntry(
        description="A flag on its pole in a gusty wind.",
        options_type=FlagOptions,
        module="pdecodec.xpbd.scene_flag",
    ),
    "jelly": SceneEntry(
        description="A spinning cube of jelly that falls on the ground; tetrahedra inside, its surface shown.",
        options_type=JellyOptions,
        module="pdecodec.xpbd.scene_jelly",
    ),
}


def build(name: str, **options: Any) -> Scene:
    """Build a scene.

    Parameters
    ----------
    name : str
        A key of :data:`SCENES`.
    **options
        As listed by ``SCENES[name].options``.

    Raises
    ------
    SettingsError
        If there is no such scene or option, or an option is out of range.
    """
    if name not in SCENES:
        raise SettingsError(f"there is no scene {name!r}; choose from {', '.join(SCENES)}")
    entry = SCENES[name]
    known = [item.name for item in entry.options]
    for key in options:
        if key not in known:
            raise SettingsError(f"scene {name} has no option {key!r}; choose from {', '.join(known)}")
    settings = entry.options_type(**options)
    scene: Scene = importlib.import_module(entry.module).build(settings)
    return scene
