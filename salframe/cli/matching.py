"""The command `matching`."""

from __future__ import annotations

from salframe.cli.options import MATCHING_METHODS, CommonOptions, Methods, timeout_option, with_common_options
from salframe.cli.output import show


@with_common_options(without=["seed"], timeout=(timeout_option("query"), None))
def matching(methods: Methods = MATCHING_METHODS, *, options: CommonOptions) -> None:
    """Measure how many matches of a method are correct.

    A match is a pair of corresponding points or objects in two panoramas. Each query is matched with the nearest
    reference frame (panorama of the map) of its room. Run the same command again to resume an interrupted run.
    """
    from salframe.evaluation.tasks.matching.task import MatchingTask, measure_matching

    request = options.request(methods)
    show(lambda progress: measure_matching(request, progress=progress), options.printing, MatchingTask)
