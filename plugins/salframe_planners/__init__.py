"""Planners that compute shortest routes on a topological map."""

import salframe
from salframe_planners.planners import Dijkstra, FloydWarshall


@salframe.hookimpl
def salframe_provides():
    return [FloydWarshall, Dijkstra]
