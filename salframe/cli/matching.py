"""matching: are the points or objects that a method matches the same ones?"""

from __future__ import annotations

from salframe.cli.options import MATCHING_METHODS, CommonOptions, Methods, with_common_options
from salframe.cli.output import show


@with_common_options(without=["seed"])
def matching(methods: Methods = MATCHING_METHODS, *, options: CommonOptions) -> None:
    """Match each query with the nearest map frame of its own place, and print how much of it is right. Run it again to
    resume.
    """
    from salframe.evaluation.tasks.matching.task import measure_matching

    request = options.request(methods)
    show(lambda progress: measure_matching(request, progress=progress), options.as_json, options.style)
