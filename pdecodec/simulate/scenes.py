"""The bundled scenes by name, and their options: frozen dataclasses with checks and help texts."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from pdecodec.errors import SettingsError

if TYPE_CHECKING:
    from pdecodec.simulate.simulation import Scene

MAX_PARTICLES = 4_000_000
"""Largest scene: about a gigabyte of state and constraints."""


class OptionInfo(NamedTuple):
    """One option, for help pages: its name with underscores, a default of its type, help with the unit.

    `choices` are the allowed values of a text.
    """

    name: str
    default: int | float | str
    help: str
    choices: tuple[str, ...]


def _option(
    default: float | str, help: str, *, smallest: float = 0, largest: float = 0, choices: tuple[str, ...] = ()
) -> Any:
    metadata = {"help": help, "smallest": smallest, "largest": largest, "choices": choices}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, kw_only=True)
class SceneOptions(ABC):
    """Base of all scenes' options; raises SettingsError for a wrong type or a value out of range."""

    def __post_init__(self) -> None:
        for item in fields(self):
            name = item.name.replace("_", "-")
            value, metadata = getattr(self, item.name), item.metadata
            if metadata["choices"]:
                if value not in metadata["choices"]:
                    raise SettingsError(f"must be one of {', '.join(metadata['choices'])}, not {value!r}", setting=name)
                continue
            whole = isinstance(item.default, int)
            if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
                raise SettingsError(f"must be a {'whole ' if whole else ''}number, not {value!r}", setting=name)
            smallest, largest = metadata["smallest"], metadata["largest"]
            if not smallest <= value <= largest:
                raise SettingsError(f"must be {smallest:g} to {largest:g}, not {value}", setting=name)
        if self.particle_count > MAX_PARTICLES:
            raise SettingsError(f"the scene would have {self.particle_count} particles; the most is {MAX_PARTICLES}")

    @property
    @abstractmethod
    def particle_count(self) -> int:
        """Number of particles that the scene simulates."""

    @classmethod
    def infos(cls) -> tuple[OptionInfo, ...]:
        """Return all options in order, for help pages."""
        return tuple(
            OptionInfo(item.name, cast(float | str, item.default), item.metadata["help"], item.metadata["choices"])
            for item in fields(cls)
        )


FACES = ("quads", "triangles")


@dataclass(frozen=True, kw_only=True)
class CubeRopeOptions(SceneOptions):
    rings: int = _option(832, "points of each curve along the rope", smallest=3, largest=100_000)
    sides: int = _option(24, "curves along the rope, around its section; a multiple of 4", smallest=4, largest=1_000)
    length: float = _option(20.0, "length [m]", smallest=0.1, largest=1e4)
    thickness: float = _option(0.5, "side of the square section [m]", smallest=1e-3, largest=1e3)
    turns: float = _option(3.0, "twist: turns of the section from end to end", smallest=-100, largest=100)
    hold: str = _option("both", "which ends are held", choices=("one", "both"))
    shake: float = _option(0.6, "distance that the held end is shaken to each side [m]", smallest=0, largest=1e3)
    faces: str = _option("quads", "faces of the surface", choices=FACES)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sides % 4:
            raise SettingsError(f"must be a multiple of 4, not {self.sides}", setting="sides")

    @property
    def particle_count(self) -> int:
        return self.rings * self.sides


@dataclass(frozen=True, kw_only=True)
class ClothOptions(SceneOptions):
    columns: int = _option(100, "vertices from side to side", smallest=2, largest=10_000)
    rows: int = _option(100, "vertices from top to bottom", smallest=2, largest=10_000)
    size: float = _option(2.0, "width [m]; the height follows from columns and rows", smallest=1e-2, largest=1e3)
    drape: str = _option("corners", "hung by two corners, or dropped on a sphere", choices=("corners", "sphere"))
    faces: str = _option("quads", "faces of the surface", choices=FACES)

    @property
    def particle_count(self) -> int:
        return self.columns * self.rows


@dataclass(frozen=True, kw_only=True)
class FlagOptions(SceneOptions):
    columns: int = _option(90, "vertices from the pole to the free end", smallest=2, largest=10_000)
    rows: int = _option(60, "vertices along the pole", smallest=2, largest=10_000)
    size: float = _option(1.5, "width [m]; the height follows from columns and rows", smallest=1e-2, largest=1e3)
    wind: float = _option(8.0, "speed of the wind [m/s]", smallest=0, largest=50)
    gusts: float = _option(0.3, "amplitude of sideways gusts, as a fraction of the wind speed", smallest=0, largest=2)
    faces: str = _option("quads", "faces of the surface", choices=FACES)

    @property
    def particle_count(self) -> int:
        return self.columns * self.rows


@dataclass(frozen=True, kw_only=True)
class JellyOptions(SceneOptions):
    cells: int = _option(12, "cubes along each edge; each has five tetrahedra", smallest=1, largest=150)
    size: float = _option(1.0, "edge [m]", smallest=1e-2, largest=1e3)
    young: float = _option(1e5, "Young's modulus [Pa]", smallest=1, largest=1e9)
    poisson: float = _option(0.4, "Poisson's ratio", smallest=0, largest=0.49)
    spin: float = _option(2.0, "initial spin [rad/s]", smallest=-100, largest=100)
    material: str = _option(
        "neo-hookean", "finite elements, or springs with constant volumes", choices=("neo-hookean", "springs")
    )
    faces: str = _option("quads", "faces of the surface", choices=FACES)

    @property
    def particle_count(self) -> int:
        return (self.cells + 1) ** 3


@dataclass(frozen=True, kw_only=True)
class SceneEntry:
    """A scene that can be built.

    Parameters
    ----------
    description : str
        One sentence.
    options_type : type of SceneOptions
    builder : str
        Module and function that build the scene from its options; imported on use.
    """

    description: str
    options_type: type[SceneOptions]
    builder: str

    @property
    def options(self) -> tuple[OptionInfo, ...]:
        """The scene's options, for help pages."""
        return self.options_type.infos()


SCENES = {
    "cube-rope": SceneEntry(
        description="A twisted rope of square section, held at its ends, that swings and is shaken.",
        options_type=CubeRopeOptions,
        builder="scene_cube_rope.build",
    ),
    "cloth": SceneEntry(
        description="A cloth that hangs by two corners, or falls on a sphere and then the ground.",
        options_type=ClothOptions,
        builder="scene_sheets.build_cloth",
    ),
    "flag": SceneEntry(
        description="A flag on its pole in a gusty wind.",
        options_type=FlagOptions,
        builder="scene_sheets.build_flag",
    ),
    "jelly": SceneEntry(
        description="A spinning cube of jelly that falls on the ground, made of tetrahedra and shown by its surface.",
        options_type=JellyOptions,
        builder="scene_jelly.build",
    ),
}


def build(name: str, **options: Any) -> Scene:
    """Build a scene.

    Parameters
    ----------
    name : str
        A key of :data:`SCENES`.
    **options
        As listed by ``SCENES[name].options``; SettingsError for any other, or one out of range.
    """
    if name not in SCENES:
        raise SettingsError(f"unknown scene {name!r}; choose from {', '.join(SCENES)}", code="unknown-name")
    entry = SCENES[name]
    known = [item.name for item in entry.options]
    for key in options:
        if key not in known:
            raise SettingsError(
                f"scene {name} has no option {key!r}; choose from {', '.join(known)}", code="unknown-name"
            )
    module, function = entry.builder.split(".")
    scene: Scene = getattr(importlib.import_module(f"pdecodec.simulate.{module}"), function)(
        entry.options_type(**options)
    )
    return scene
