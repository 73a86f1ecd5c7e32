"""The command `fit`: fit the parameters of a method to tuning data."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import DataDir, SetForMethod


def fit(
    method: Annotated[
        str,
        typer.Argument(
            metavar="METHOD",
            help="Method to fit, such as `proposed`; its settings (`salframe show METHOD`) must include `posterior`",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.yaml", help="YAML file to write the fitted parameters to")
    ],
    data: Annotated[
        list[str],
        typer.Option(
            metavar="DATASET", help="Dataset to fit to; repeatable. Use other datasets to evaluate the fitted method"
        ),
    ],
    tries: Annotated[
        list[str] | None,
        typer.Option(
            "--try",
            metavar="KEY=VALUE,VALUE",
            help="Values to try for a setting, such as matcher.hops=1,2; the fit selects the best value; repeatable",
        ),
    ] = None,
    posterior_only: Annotated[
        bool,
        typer.Option(
            "--posterior-only",
            help="Fit only the conversion of scores to probabilities (posterior), not the weights of the score; cannot "
            "be combined with --try",
        ),
    ] = False,
    data_dir: DataDir = None,
    overrides: SetForMethod = None,
) -> None:
    """Fit the parameters of a method to tuning data.

    There are three steps. First, the best value of each setting in --try is selected. Then the weights of the terms of
    the score are fitted, if the method has weights. Then the posterior is fitted. The posterior converts scores to the
    probability of each place and the out-of-map probability. To use the fitted parameters, add `--set
    posterior=FILE.yaml --set weights=FILE.yaml` to another command. FILE.yaml also contains the values that --try
    selected. They are not applied by these options: add --set KEY=VALUE for each of them.
    """
    from salframe.cli.output import Bars, tell
    from salframe.evaluation.studies.fitting import fit_method

    with Bars() as bars:
        lines = fit_method(
            method,
            data,
            output,
            tries=tries or (),
            posterior_only=posterior_only,
            data_dir=data_dir,
            overrides=overrides or (),
            progress=bars.update,
            tell=tell,
        )
    for line in lines:
        print(line)
    print(output)
