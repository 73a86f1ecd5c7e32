"""`python -m training.loftr_compact FOLDER`: render panoramas, train and export `loftr-compact`, or resume."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.framework.config import merge, parse_override
from salframe.framework.errors import SalframeError
from salframe.framework.overrides import nest
from salframe.framework.validation import validate
from training.loftr_compact.export import export
from training.loftr_compact.panoramas import render
from training.loftr_compact.settings import LoftrTrainingSettings
from training.loftr_compact.train import train


def main(
    folder: Annotated[Path, typer.Argument(help="Folder for checkpoint, log and ONNX files.")],
    overrides: Annotated[
        list[str] | None, typer.Option("--set", help="Override a training setting, as key.path=value (repeatable).")
    ] = None,
) -> None:
    """Render the panoramas, train and export. Steps that are done are skipped."""
    settings: dict = {}
    for text in overrides or []:
        settings = merge(settings, nest(*parse_override(text)))
    try:
        config = validate(LoftrTrainingSettings, settings, "")
        buildings = max(stage.buildings for stage in config.stages)
        seeds = range(config.held_out_seed, config.held_out_seed + 1 + buildings)
        render(config.panoramas, seeds, lambda done, total: print(f"rendered {done} of {total} buildings", flush=True))
        export(train(config, folder, lambda row: print(row, flush=True)), folder)
    except SalframeError as error:
        raise SystemExit(f"error: {error}") from None


if __name__ == "__main__":
    typer.run(main)
