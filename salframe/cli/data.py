"""data list, data info, data render: what there is to localize in."""

from __future__ import annotations

import typer

from salframe.cli.options import ENGINE, DataArgument, DataDir, EngineName, Json, Set, Workers, with_workers
from salframe.cli.output import print_json

app = typer.Typer(help="Look at datasets, and make the rendered ones.", no_args_is_help=True)


@app.command("list")
def list_(as_json: Json = False) -> None:
    """List datasets and their presets."""
    from salframe.cli.tables import print_table
    from salframe.framework.components.installation import list_components
    from salframe.framework.components.presets import names, settings
    from salframe.framework.errors import SalframeError

    summaries = {component.name: component.summary for component in list_components() if component.role == "dataset"}
    rows = []
    for name in names("dataset"):
        try:
            kind = settings("dataset", name)["kind"]
        except SalframeError as error:
            rows.append([name, "", str(error)])
        else:
            rows.append([name, kind, summaries.get(kind, "its plugin is not at hand: salframe doctor")])
    if as_json:
        print_json([dict(zip(("name", "kind", "summary"), row, strict=True)) for row in rows])
    else:
        print_table(("name", "dataset", ""), rows)


@app.command()
def info(data: DataArgument, data_dir: DataDir = None, overrides: Set = None, as_json: Json = False) -> None:
    """Count a dataset's folds, reference frames, queries and places; renders it where that was not done."""
    from salframe.cli.output import Bars, tell_units
    from salframe.panoramas.opening import find_dataset, reference_frames

    with Bars() as bars:
        dataset = find_dataset(data, data_dir, overrides or (), bars.update)
    folds, mapping = dataset.folds(), reference_frames(dataset)
    tell_units(mapping)
    queries = {query.id for fold in folds for query in fold.queries}
    facts = {
        "name": dataset.name,
        "version": dataset.version,
        "provides": sorted(dataset.provides),
        "folds": len(folds),
        "reference_frames": len(mapping),
        "queries": len(queries),
        "mapped_places": len({frame.place for frame in mapping}),
        "queried_places": len({dataset.truth(query).place for query in queries}),
        "fingerprint": dataset.question_key,
    }
    if as_json:
        print_json(facts)
    else:
        for key, value in facts.items():
            print(f"{key.replace('_', ' ')}: {', '.join(value) if isinstance(value, list) else value}")


@app.command()
def render(
    data: DataArgument,
    data_dir: DataDir = None,
    overrides: Set = None,
    engine: EngineName = ENGINE,
    workers: Workers = None,
) -> None:
    """Prepare a dataset now that `compare` would prepare when it first needs it; run it again to resume."""
    from salframe.cli.output import Bars
    from salframe.panoramas.opening import find_dataset

    with Bars() as bars:
        dataset = find_dataset(data, data_dir, with_workers(overrides, workers), bars.update, engine)
    print(f"{data} is ready: fingerprint {dataset.fingerprint}")
