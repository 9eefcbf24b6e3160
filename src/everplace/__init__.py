"""everplace recognises a place again in another season, weather or light.

    import everplace as ep

    route = ep.open_route("my-route")
    run = ep.load("runs/cp-vae")
    query, database = run.describe(route["winter"]), run.describe(route["summer"])
    S = ep.similarity(query, database)
    scores = ep.evaluate(S, ep.truth_by_position(route["winter"], route["summer"], tolerance=1))
    result = ep.retrieve(route, "winter", "summer", "hog")  # all of it at once, by the truth that the route states

Names are imported when they are first used, so that `import everplace` stays light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from everplace.alignment.aligned_route import align
    from everplace.describe.describer import Describer
    from everplace.describe.files.descriptors import Descriptors, load_descriptors
    from everplace.describe.registry import load
    from everplace.errors import EverplaceError
    from everplace.mapping.localizer import Localizer
    from everplace.mapping.map_answer import MapAnswer
    from everplace.mapping.route_learning import Adaptation, adapt
    from everplace.mapping.route_map import Map
    from everplace.match.matching import Matching
    from everplace.match.new_place import new_place_probability
    from everplace.match.similarity import similarity, similarity_blocks, top_k
    from everplace.match.standardise import standardise
    from everplace.route.route import Route, open_route
    from everplace.route.selection import Selection, parse_frames, select
    from everplace.route.traverse import Frame, Traverse
    from everplace.route.truth import truth_by_pose, truth_by_position
    from everplace.scoring.retrieval import Retrieval, retrieve
    from everplace.scoring.scores import Scores, evaluate, precision_recall
    from everplace.sequences.route_filter import Answer, RouteFilter
    from everplace.sequences.route_model import RouteModel
    from everplace.sequences.route_path import best_path, smooth_route
    from everplace.sequences.sequence_search import average_sequences, search_sequences
    from everplace.training.fitted_methods import train

__all__ = [
    "Adaptation",
    "Answer",
    "Describer",
    "Descriptors",
    "EverplaceError",
    "Frame",
    "Localizer",
    "Map",
    "MapAnswer",
    "Matching",
    "Retrieval",
    "Route",
    "RouteFilter",
    "RouteModel",
    "Scores",
    "Selection",
    "Traverse",
    "adapt",
    "align",
    "average_sequences",
    "best_path",
    "evaluate",
    "load",
    "load_descriptors",
    "new_place_probability",
    "open_route",
    "parse_frames",
    "precision_recall",
    "retrieve",
    "search_sequences",
    "select",
    "similarity",
    "similarity_blocks",
    "smooth_route",
    "standardise",
    "top_k",
    "train",
    "truth_by_pose",
    "truth_by_position",
]

_HOME = {
    "Adaptation": "mapping.route_learning",
    "Answer": "sequences.route_filter",
    "Describer": "describe.describer",
    "Descriptors": "describe.files.descriptors",
    "EverplaceError": "errors",
    "Frame": "route.traverse",
    "Localizer": "mapping.localizer",
    "Map": "mapping.route_map",
    "MapAnswer": "mapping.map_answer",
    "Matching": "match.matching",
    "Retrieval": "scoring.retrieval",
    "Route": "route.route",
    "RouteFilter": "sequences.route_filter",
    "RouteModel": "sequences.route_model",
    "Scores": "scoring.scores",
    "Selection": "route.selection",
    "Traverse": "route.traverse",
    "adapt": "mapping.route_learning",
    "align": "alignment.aligned_route",
    "average_sequences": "sequences.sequence_search",
    "best_path": "sequences.route_path",
    "evaluate": "scoring.scores",
    "load": "describe.registry",
    "load_descriptors": "describe.files.descriptors",
    "new_place_probability": "match.new_place",
    "open_route": "route.route",
    "parse_frames": "route.selection",
    "precision_recall": "scoring.scores",
    "retrieve": "scoring.retrieval",
    "search_sequences": "sequences.sequence_search",
    "select": "route.selection",
    "similarity": "match.similarity",
    "similarity_blocks": "match.similarity",
    "smooth_route": "sequences.route_path",
    "standardise": "match.standardise",
    "top_k": "match.similarity",
    "train": "training.fitted_methods",
    "truth_by_pose": "route.truth",
    "truth_by_position": "route.truth",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'everplace' has no attribute {name!r}")
    value = getattr(import_module(f"everplace.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
