"""The plugin of the core package: it provides the roles, and the dataset that reads the folder format."""

from __future__ import annotations

import salframe
from salframe.evaluation.scorer import Scorer
from salframe.framework.engines.engine import Engine
from salframe.graphs.detector import Detector
from salframe.graphs.matcher import GraphMatcher
from salframe.graphs.saliency import SaliencyModel
from salframe.graphs.scene_index import SceneIndex
from salframe.localization.evidence_model import EvidenceModel
from salframe.localization.localizer import Localizer
from salframe.localization.positioner import Positioner
from salframe.localization.tracker import Tracker
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.importer import Importer
from salframe.panoramas.range_model import RangeModel
from salframe.topology.planner import Planner


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """Return the roles and components of the core."""
    return [
        Dataset,
        Importer,
        RangeModel,
        Detector,
        SaliencyModel,
        SceneIndex,
        GraphMatcher,
        Positioner,
        EvidenceModel,
        Planner,
        Scorer,
        Localizer,
        Tracker,
        Engine,
        FolderDataset,
    ]
