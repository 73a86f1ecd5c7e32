"""The commands `data list`, `data info` and `data render`."""

from __future__ import annotations

import typer

from salframe.cli.options import ENGINE, DataArgument, DataDir, EngineName, Json, Set, Workers, with_workers
from salframe.cli.output import print_json

app = typer.Typer(help="List, inspect and render datasets", no_args_is_help=True)


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
            rows.append([name, kind, summaries.get(kind, "plugin is not installed; run: salframe doctor")])
    if as_json:
        print_json([dict(zip(("name", "kind", "summary"), row, strict=True)) for row in rows])
    else:
        print_table(("name", "dataset", ""), rows)


@app.command()
def info(data: DataArgument, data_dir: DataDir = None, overrides: Set = None, as_json: Json = False) -> None:
    """Print the numbers of folds, reference frames, queries and places.

    Renders the dataset first if necessary.
    """
    from contextlib import suppress

    from salframe.cli.output import Bars, tell, warn
    from salframe.evaluation.true_places import places_notes
    from salframe.framework.errors import DataError, TruthMissing
    from salframe.panoramas.data_checks import data_notes
    from salframe.panoramas.opening import find_dataset, reference_frames

    with Bars() as bars:
        dataset = find_dataset(data, data_dir, overrides or (), bars.update)
    folds, references = dataset.folds(), reference_frames(dataset)
    try:
        for note in data_notes(dataset):
            warn(note)
    except DataError as error:  # building a map stops with it
        warn(str(error))
    for note in places_notes(dataset):
        tell(note)
    queries = {query.id for fold in folds for query in fold.queries}
    true_places = {}
    for query in queries:
        with suppress(TruthMissing):
            true_places[query] = dataset.truth(query).place
    facts = {
        "name": dataset.name,
        "version": dataset.version,
        "provides": sorted(dataset.provides),
        "folds": len(folds),
        "reference_frames": len(references),
        "queries": len(queries),
        "mapped_places": len({frame.place for frame in references}),
        "queried_places": len(set(true_places.values())),
        "queries_without_truth": len(queries) - len(true_places),
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
    """Prepare a dataset in advance.

    Without this command, `compare` prepares the dataset on first use. Run the same command again to resume an
    interrupted run.
    """
    from salframe.cli.output import Bars
    from salframe.panoramas.opening import find_dataset

    with Bars() as bars:
        dataset = find_dataset(data, data_dir, with_workers(overrides, workers), bars.update, engine)
    print(f"{data} is ready: fingerprint {dataset.fingerprint}")
