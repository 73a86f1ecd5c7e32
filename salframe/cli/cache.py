"""The commands `cache info` and `cache clear`."""

from __future__ import annotations

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json

app = typer.Typer(help="Show or clear the cache of the results that methods computed.", no_args_is_help=True)


@app.command()
def info(as_json: Json = False) -> None:
    """Show the folder, size and size limit of the cache.

    Also shows the number of entries. The environment variable SALFRAME_CACHE_GB changes the limit.
    """
    from dataclasses import asdict

    from salframe.evaluation.tables.text import format_bytes
    from salframe.framework.files.cache import Cache

    state = Cache().state()
    if as_json:
        print_json({**asdict(state), "directory": str(state.directory)})
        return
    size, limit = format_bytes(state.size_bytes), format_bytes(state.limit_bytes)
    print(f"{state.directory}: {state.entries} entries, {size} of at most {limit}")


@app.command()
def clear() -> None:
    """Remove all entries of the cache.

    Descriptions are computed again when they are needed. Rendered data and network weights are not removed.
    """
    from salframe.evaluation.tables.text import format_bytes
    from salframe.framework.files.cache import Cache

    before = Cache().clear()
    print(f"{before.directory}: removed {before.entries} entries, {format_bytes(before.size_bytes)}")
