"""Components for the localizer saliency-graph: a saliency model, a matcher and a positioner."""

import numpy as np
from pydantic import Field
from scipy.optimize import linear_sum_assignment

import salframe


class ApparentSize(salframe.SaliencyModel):
    """Share of the solid angle of all objects, so that large and near objects are salient."""

    name = "apparent-size"
    version = "1"

    def score(self, detections):
        distance_m = np.linalg.norm(detections.centroid_m, axis=1)
        angle = np.nan_to_num((detections.size_m.max(1, initial=0) / np.maximum(distance_m, 0.1)) ** 2)
        return angle / angle.sum() if angle.any() else np.full(len(angle), 1 / max(len(angle), 1))


class BoxSizes(salframe.GraphMatcher):
    """Pairs objects with the same label and similar box size. The score is the mean similarity of all objects."""

    name = "box-sizes"
    version = "1"

    class Config(salframe.ComponentConfig):
        tolerance_m: float = salframe.match_only(
            0.2, gt=0, description="difference in size at which the similarity is 1/e"
        )

    def index(self, graphs):
        return list(graphs)

    def match(self, query, index, top_k):
        matches = [self._match(query, graph, scene) for scene, graph in enumerate(index)]
        return sorted((match for match in matches if len(match.pairs)), key=lambda match: -match.score)[:top_k]

    def _match(self, query, graph, scene):
        difference_m = np.abs(query.size_m[:, None] - graph.size_m).max(-1, initial=0)
        similarity = np.nan_to_num(np.exp(-difference_m / self.config.tolerance_m))  # the size is unknown without range
        similarity *= np.array(query.labels, str)[:, None] == np.array(graph.labels, str)
        rows, columns = linear_sum_assignment(similarity, maximize=True)
        paired = similarity[rows, columns] > 0
        score = similarity[rows, columns].sum() / max(len(query), len(graph), 1)
        return salframe.GraphMatch(scene, float(score), np.column_stack([rows[paired], columns[paired]]))


class PlanarFit(salframe.Positioner):
    """Upright rigid motion by least squares in closed form. Pairs within a maximum distance are inliers."""

    name = "planar-fit"
    version = "1"

    class Config(salframe.ComponentConfig):
        inlier_m: float = Field(0.5, gt=0, description="maximum distance of an inlier pair")

    def solve(self, query_m, reference_m, weights=None):
        no_inliers = np.zeros(len(query_m), bool)
        if len(query_m) < 2:
            return salframe.PoseEstimate(None, salframe.PoseStatus.TOO_FEW, None, no_inliers)
        share = np.ones(len(query_m)) if weights is None or not weights.any() else weights
        share = share / share.sum()
        middle_m, goal_m = share @ query_m, share @ reference_m
        query, reference = (points[:, 0] + 1j * points[:, 1] for points in (query_m - middle_m, reference_m - goal_m))
        turn = share @ (query.conj() * reference)
        if abs(turn) < 1e-9:  # m^2: all points of one side coincide
            return salframe.PoseEstimate(None, salframe.PoseStatus.DEGENERATE, None, no_inliers)
        pose = salframe.pose_2d(0, 0, float(np.angle(turn)))
        pose[:3, 3] = goal_m - salframe.transform_points(pose, middle_m)
        distance_m = np.linalg.norm(salframe.transform_points(pose, query_m) - reference_m, axis=1)
        return salframe.PoseEstimate(pose, salframe.PoseStatus.OK, None, distance_m < self.config.inlier_m)
