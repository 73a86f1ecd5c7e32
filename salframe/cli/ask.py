"""The command `ask`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json


def ask(
    map: Annotated[Path, typer.Argument(metavar="MAP", help="Map folder that `salframe build` wrote")],
    text: Annotated[
        str, typer.Argument(metavar="TEXT", help='Description of a room, such as "sofa, two plants left of the bed"')
    ],
    as_json: Json = False,
) -> None:
    """Find the places of a map that fit a text.

    Prints the five likeliest places with their probabilities, and the yes-or-no question that would best tell them
    apart. Commas separate objects. A number or "no" may stand before an object. "left of", "right of" or "opposite" may
    stand between two objects. Colours and unknown words are ignored, with a note.
    """
    from salframe.localization.map import open_map
    from salframe.localization.text_places import ask as run

    answer = run(open_map(map), text)
    if as_json:
        print_json(answer.to_json())
    else:
        print(answer)
