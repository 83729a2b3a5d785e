"""`pdecodec coefficients`: write the 32 coefficients of Eq. 17 from a `.pdeanim` file, and their basis functions."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import counted, say
from pdecodec.cli.jobs import local_output
from pdecodec.cli.options import check_apart, check_output, output_option, overwrite_option, within_limits
from pdecodec.errors import InputError, SettingsError, naming_file
from pdecodec.system.storage import is_address
from pdecodec.system.whole_output import whole_file

if TYPE_CHECKING:
    from pdecodec.codec.paper_form import PaperForm

AXES = "xyz"


@click.command()
@click.argument("source", metavar="FILE")
@output_option
@within_limits
@overwrite_option
def coefficients(*, source: str, output: str, overwrite: bool) -> None:
    """Write the 32 coefficients of each curve, axis and time segment of FILE, which was encoded with --profile paper.

    They are the coefficients of Eq. 17. A .npz file holds everything that Eq. 18 needs, as arrays: coefficients
    (groups, pieces, axes, 4 of time, 8 of space), condition, order, starts, reference, u, r, times, and for each group
    alpha, centre, half_length, first_frame. A .csv file has one row per group, piece and axis: alpha, r, condition,
    c_w1 to c_w32.
    """
    from pdecodec.codec.opening import open_animation

    path = Path(output)
    if path.suffix.lower() not in (".npz", ".csv"):
        raise SettingsError("coefficients are written as .npz or .csv; choose one of these", path=output)
    check_output(output, overwrite=overwrite)
    if not is_address(source) and not Path(source).is_file():
        raise InputError("this file does not exist", code="file-missing", path=source)
    check_apart([source], [output])
    with naming_file(source), open_animation(source) as animation:
        forms = [animation.coefficients(group) for group in range(animation.info()["groups"])]
    with local_output(output, overwrite=overwrite) as place, whole_file(place, overwrite=overwrite) as partial:
        if path.suffix.lower() == ".npz":
            import numpy as np

            with partial.open("wb") as file:
                np.savez_compressed(file, **_arrays(forms))
        else:
            _write_rows(partial, forms)
    pieces = len(forms[0].coefficients)
    say(
        f"{output}: 32 coefficients for {counted(pieces, 'curve')}, 3 axes and {counted(len(forms), 'segment')} of time"
    )


def _arrays(forms: list[PaperForm]) -> dict[str, Any]:
    import numpy as np

    first = forms[0]
    of_groups = ("alpha", "centre", "half_length", "first_frame")
    return {
        "coefficients": np.stack([form.coefficients for form in forms]),
        "condition": np.stack([form.condition for form in forms]),
        **{name: np.array(getattr(first, name)) for name in ("order", "starts", "reference", "u", "r")},
        **{name: np.array([getattr(form, name) for form in forms]) for name in of_groups},
        "times": np.concatenate([form.times for form in forms]),
    }


def _write_rows(path: Path, forms: list[PaperForm]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        numbers = [f"c_w{number}" for number in range(1, 33)]
        writer.writerow(["segment", "piece", "axis", "alpha", "r", "condition", *numbers])
        for segment, form in enumerate(forms):
            for piece, condition in enumerate(form.condition):
                for axis, name in enumerate(AXES):
                    row = form.coefficients[piece, axis].ravel().tolist()
                    writer.writerow([segment, piece, name, form.alpha, form.r, float(condition), *row])
