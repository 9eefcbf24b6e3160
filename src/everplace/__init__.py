"""everplace recognises a place again in another season, weather or light.

    import everplace as ep

    route = ep.open_route("my-route")
    run = ep.load("runs/cp-vae")
    query, database = run.describe(route["winter"]), run.describe(route["summer"])
    S = ep.similarity(query, database)
    scores = ep.evaluate(S, ep.truth_by_position(route["winter"], route["summer"], tolerance=1))

Names are imported when they are first used, so that `import everplace` stays light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from everplace.data.route import Route, open_route
    from everplace.data.selection import Selection, parse_frames, select
    from everplace.data.traverse import Frame, Traverse
    from everplace.data.truth import truth_by_pose, truth_by_position
    from everplace.describe.descriptors import Descriptors, load_descriptors
    from everplace.describe.run import Method, load
    from everplace.errors import EverplaceError
    from everplace.match.place_posterior import new_place_probability
    from everplace.match.route_filter import Answer, RouteFilter
    from everplace.match.route_model import RouteModel
    from everplace.match.route_path import best_path, smooth_route
    from everplace.match.sequence import average_sequences, search_sequences
    from everplace.match.similarity import similarity, similarity_blocks, top_k
    from everplace.match.standardise import standardise
    from everplace.scoring.scores import Scores, evaluate, precision_recall

__all__ = [
    "Answer",
    "Descriptors",
    "EverplaceError",
    "Frame",
    "Method",
    "Route",
    "RouteFilter",
    "RouteModel",
    "Scores",
    "Selection",
    "Traverse",
    "average_sequences",
    "best_path",
    "evaluate",
    "load",
    "load_descriptors",
    "new_place_probability",
    "open_route",
    "parse_frames",
    "precision_recall",
    "search_sequences",
    "select",
    "similarity",
    "similarity_blocks",
    "smooth_route",
    "standardise",
    "top_k",
    "truth_by_pose",
    "truth_by_position",
]

_HOME = {
    "Answer": "match.route_filter",
    "Descriptors": "describe.descriptors",
    "EverplaceError": "errors",
    "Frame": "data.traverse",
    "Method": "describe.run",
    "Route": "data.route",
    "RouteFilter": "match.route_filter",
    "RouteModel": "match.route_model",
    "Scores": "scoring.scores",
    "Selection": "data.selection",
    "Traverse": "data.traverse",
    "average_sequences": "match.sequence",
    "best_path": "match.route_path",
    "evaluate": "scoring.scores",
    "load": "describe.run",
    "load_descriptors": "describe.descriptors",
    "new_place_probability": "match.place_posterior",
    "open_route": "data.route",
    "parse_frames": "data.selection",
    "precision_recall": "scoring.scores",
    "search_sequences": "match.sequence",
    "select": "data.selection",
    "similarity": "match.similarity",
    "similarity_blocks": "match.similarity",
    "smooth_route": "match.route_path",
    "standardise": "match.standardise",
    "top_k": "match.similarity",
    "truth_by_pose": "data.truth",
    "truth_by_position": "data.truth",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'everplace' has no attribute {name!r}")
    value = getattr(import_module(f"everplace.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
