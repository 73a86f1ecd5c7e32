"""The method of the paper: volumetric saliency, graph matching, positioning, and the localizers that combine them."""

import salframe
from salframe_graphs.geometric import GeometricMatcher
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.places.evidence_components import (
    LabelEvidence,
    LikelihoodEvidence,
    OutlineEvidence,
    PanoramaEvidence,
)
from salframe_graphs.places.localizer import SaliencyPlacesLocalizer
from salframe_graphs.positioning import LeastSquaresPositioner, RobustPositioner
from salframe_graphs.retrieval.by_size import BySize
from salframe_graphs.retrieval.compiled_lists import CompiledLists
from salframe_graphs.retrieval.inverted_lists import InvertedLists
from salframe_graphs.saliency import RandomSaliency, UniformSaliency, VolumetricSaliency
from salframe_graphs.triplet import TripletMatcher


@salframe.hookimpl
def salframe_provides():
    return [
        VolumetricSaliency,
        UniformSaliency,
        RandomSaliency,
        InvertedLists,
        GeometricMatcher,
        CompiledLists,
        BySize,
        TripletMatcher,
        RobustPositioner,
        LeastSquaresPositioner,
        LikelihoodEvidence,
        OutlineEvidence,
        PanoramaEvidence,
        LabelEvidence,
        SaliencyGraphLocalizer,
        SaliencyPlacesLocalizer,
    ]
