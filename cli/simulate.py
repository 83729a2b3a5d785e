"""`pdecodec simulate`: simulate a bundled scene. Each scene is a command with the scene's own options."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import extent, print_json, progress_bar, say, say_notices
from pdecodec.cli.options import (
    check_output,
    is_gltf,
    json_option,
    motion_options,
    output_option,
    overwrite_option,
    refuse_pdeanim,
)
from pdecodec.errors import SettingsError
from pdecodec.simulate.scenes import SCENES, OptionInfo

if TYPE_CHECKING:
    from pdecodec.codec.settings import EncodeSettings


@click.group(subcommand_metavar="SCENE -o OUT [OPTIONS]")
def simulate() -> None:
    """Simulate a bundled scene with XPBD, and write the mesh sequence.

    Each scene has its own options: `pdecodec simulate SCENE --help` lists them.

    Limits of the simulation: meshes collide neither with themselves nor with each other. The ground and the sphere do
    not move. They stop particles, not the edges and faces between them, so a sphere smaller than a face slips through.
    Contact is tested at the end of each substep, so a particle that crosses the sphere within one substep goes through.
    Nothing bounces, tears or flows. Air pushes and drags the mesh, but the mesh does not move the air.
    """


def _scene_command(name: str) -> click.Command:
    """Return the command of one scene, with the options that the scene lists."""

    def run(**given: Any) -> None:
        settings = {option.name: given.pop(option.name) for option in SCENES[name].options}
        _simulate(name, settings, **given)

    decorators = (
        output_option,
        click.option(
            "--frames",
            type=int,
            metavar="N",
            help="Number of frames; the first is the rest state.  [default: that of the scene]",
        ),
        click.option("--fps", type=float, default=24.0, show_default=True, metavar="F", help="Frames per second."),
        click.option("--substeps", type=int, metavar="N", help="Substeps per frame.  [default: that of the scene]"),
        click.option(
            "--iterations",
            type=int,
            default=1,
            show_default=True,
            metavar="N",
            help="Sweeps over all constraints per substep.",
        ),
        click.option(
            "--method",
            type=click.Choice(["xpbd", "pbd"]),
            default="xpbd",
            show_default=True,
            help="pbd: the stiffness depends on substeps and iterations; for comparison.",
        ),
        click.option(
            "--fields",
            is_flag=True,
            help="Also write velocities, elastic energies and Lagrange multipliers, as fields of the vertices.",
        ),
        *(_scene_option(option) for option in SCENES[name].options),
        motion_options,
        overwrite_option,
        json_option,
    )
    for decorate in reversed(decorators):
        run = decorate(run)
    return click.command(name, help=SCENES[name].description, short_help=SCENES[name].description)(run)


def _scene_option(option: OptionInfo) -> Any:
    kind = click.Choice(option.choices) if option.choices else type(option.default)
    metavar = None if option.choices else "N" if isinstance(option.default, int) else "X"
    text = f"{option.help[0].upper()}{option.help[1:]}."
    flag = f"--{option.name.replace('_', '-')}"
    return click.option(flag, type=kind, default=option.default, show_default=True, metavar=metavar, help=text)


def _simulate(
    name: str,
    options: dict[str, Any],
    *,
    output: str,
    frames: int | None,
    fps: float,
    substeps: int | None,
    iterations: int,
    method: Any,
    fields: bool,
    motion: EncodeSettings | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    from pdecodec.formats import write_sequence
    from pdecodec.simulate import build

    started = time.perf_counter()
    refuse_pdeanim(output, f"simulate to .npz or .h5 first, then pdecodec encode it into {output}")
    check_output(output, overwrite=overwrite)
    if motion is not None and not is_gltf(output):
        raise SettingsError("is for glTF; leave it out", code="setting-unsupported", path=output, setting="motion")
    scene = build(name, **options)
    sequence = scene.simulate(
        frames=frames, fps=fps, substeps=substeps, iterations=iterations, method=method, fields=fields
    )
    with progress_bar() as progress:
        notices = write_sequence(sequence, output, overwrite=overwrite, progress=progress, motion=motion)
    say_notices(notices)
    seconds = time.perf_counter() - started
    counts = {"frames": sequence.frame_count, "vertices": sequence.vertex_count}
    if as_json:
        print_json(
            {
                "output": output,
                "scene": name,
                **counts,
                "fps": fps,
                "fields": sequence.field_facts(),
                "seconds": seconds,
                "notices": list(notices),
            },
            outputs_are_written=True,
        )
    say(f"{output}: {extent(sequence)}, {seconds:.1f} s")


for _name in SCENES:
    simulate.add_command(_scene_command(_name))
