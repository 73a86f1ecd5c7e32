"""The commands `data list`, `data info`, `data labels`, `data render` and `data import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from salframe.cli.options import ENGINE, DataArgument, DataDir, EngineName, Json, SetForData, Workers, with_workers
from salframe.cli.output import print_json

app = typer.Typer(help="List, inspect, render and import datasets.", no_args_is_help=True)


@app.command("list")
def list_(as_json: Json = False) -> None:
    """List the names of datasets that --data accepts."""
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
        print_table(("name", "kind", "description"), rows)


@app.command()
def info(data: DataArgument, data_dir: DataDir = None, overrides: SetForData = None, as_json: Json = False) -> None:
    """Check a dataset, and count its frames, queries and places.

    Counts the reference frames (panoramas for maps) and the queries (views to localize). Renders the dataset first if
    necessary.
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
    except DataError as error:  # building a map raises this error
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
        "fingerprint": dataset.query_key,
    }
    if as_json:
        print_json(facts)
    else:
        for key, value in facts.items():
            print(f"{key.replace('_', ' ')}: {', '.join(value) if isinstance(value, list) else value}")


@app.command()
def labels(data: DataArgument, data_dir: DataDir = None, overrides: SetForData = None, as_json: Json = False) -> None:
    """List the object labels of a dataset, and count the objects.

    Lists each label of the annotated objects with the number of its objects. The vocabulary is the list of labels
    and synonyms that salframe knows. Methods compare labels by their names in the vocabulary. A label that is not
    in the vocabulary is listed with the most similar names. The exit status is 1 if a panorama cannot be read.
    """
    from collections import Counter
    from dataclasses import asdict

    from salframe.cli.output import Bars, tell
    from salframe.cli.tables import print_table
    from salframe.graphs.label_list import LabelStatus, list_labels
    from salframe.panoramas.opening import find_dataset

    with Bars() as bars:
        result = list_labels(find_dataset(data, data_dir, overrides or (), bars.update), bars.update)
    notes = {
        LabelStatus.KNOWN: "",
        LabelStatus.UNKNOWN: "not in the vocabulary",
        LabelStatus.NOT_OBJECT: "no class of objects",
        LabelStatus.MOVING: "moves, so maps do not contain it",
    }
    if as_json:
        print_json(asdict(result))
    else:
        rows = [
            [
                row.label,
                row.name,
                row.common if row.common != row.name else "",
                str(row.objects),
                notes[row.status] + (f"; similar: {', '.join(row.near)}" if row.near else ""),
            ]
            for row in result.labels
        ]
        print_table(("label", "name", "kind of", "objects", ""), rows)
        counts = Counter(row.status for row in result.labels)
        named = [f"{note}: {counts[status]}" for status, note in notes.items() if note and counts[status]]
        print(f"{len(rows)} labels ({'; '.join(named) or 'all in the vocabulary'})")
    for id, error in result.failures.items():
        tell(f"error: {id}: {error}")
    if result.failures:
        raise typer.Exit(1)


@app.command()
def render(
    data: DataArgument,
    data_dir: DataDir = None,
    overrides: SetForData = None,
    engine: EngineName = ENGINE,
    workers: Workers = None,
) -> None:
    """Render or index the images of a dataset in advance.

    An index is a list of the image files. Without this command, the images are rendered or indexed by the first
    command that uses the dataset. Run the same command again to resume an interrupted run.
    """
    from salframe.cli.output import Bars
    from salframe.panoramas.opening import find_dataset

    with Bars() as bars:
        dataset = find_dataset(data, data_dir, with_workers(overrides, workers), bars.update, engine)
    print(f"{data} is ready: fingerprint {dataset.fingerprint}")


@app.command("import")
def import_(
    format: Annotated[
        str,
        typer.Argument(metavar="FORMAT", help="Format of the recording, such as rosbag; see `salframe show importer`"),
    ],
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="Folder or file of the recording")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write the dataset to")],
    place_from: Annotated[
        Literal["column", "region", "folder", "none"] | None,
        typer.Option(
            help="Source of place names. column: the column or key `place` of the recording; region: the rooms "
            "(regions) of a building model or of floor masks; folder: the folders of the pictures; none: the dataset "
            "has a separate place for each panorama of the map, and `salframe build` replaces these places by rooms "
            "that it finds. Default: the first of these that names the place of every panorama of the map"
        ),
    ] = None,
    queries: Annotated[
        str | None,
        typer.Option(
            metavar="every:N|FILE",
            help="Panoramas that become queries: every Nth of those with a pose, or those in a text file (one id per "
            "line)",
        ),
    ] = None,
    every: Annotated[
        str | None,
        typer.Option(
            metavar="Nm|Ns",
            help="Minimum distance or time between panoramas with poses, such as 0.5m or 2s; closer ones are left out",
        ),
    ] = None,
    floors: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="YAML file that lists images of the floor (floor masks), for place names and routes; see `salframe "
            "docs import`",
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change a setting of the importer that reads the recording, such as poses=tf; see `salframe "
            "show FORMAT`",
        ),
    ] = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Write no dataset: print a summary, and draw a sample of the panoramas and a top view of all poses",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Convert a recording of another format to a folder of panoramas.

    Every command accepts the folder as a dataset. Panoramas without a pose become queries. A panorama that cannot be
    read is left out, and the exit status is then 1. --place-from selects the source of place names: a column of the
    recording, the rooms (regions) of a building model or of floor masks, or the folders of pictures. With `--place-from
    none`, each reference frame is a separate place. Run the same command again to resume an interrupted import.
    """
    from salframe.cli.output import Bars, tell, warn
    from salframe.drawing.import_preview import preview_import
    from salframe.panoramas.importing import import_data

    run = preview_import if dry_run else import_data
    with Bars() as bars:
        result = run(
            format,
            source,
            output,
            settings=overrides or (),
            place_from=place_from,
            queries=queries,
            every=every,
            floors=floors,
            progress=bars.update,
        )
    if as_json:
        print_json(result.to_json())
    else:
        print("\n".join(result.lines()))
    for note in result.notes:
        warn(note)
    for id, error in result.failures.items():
        tell(f"error: {id}: {error}")
    if result.failures:
        raise typer.Exit(1)
