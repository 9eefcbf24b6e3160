from __future__ import annotations

from pathlib import Path

import pytest

from everplace.errors import RouteError
from everplace.route.route import Route, open_route


def make(root: Path, **traverses: list[str]) -> Path:
    for name, stems in traverses.items():
        (root / name).mkdir(parents=True)
        for stem in stems:
            (root / name / f"{stem}.png").touch()
    return root


@pytest.fixture
def seasons(tmp_path: Path) -> Route:
    make(tmp_path, jan=["1", "2", "10"], feb=["2", "10", "11"], july=["10", "2", "3"])
    (tmp_path / "route.toml").write_text(
        'tolerance = 2\n[traverses.jan]\ncondition = "winter"\n[traverses.feb]\ncondition = "winter"\n'
    )
    return open_route(tmp_path)


def test_the_tiny_route(tiny_route: Path) -> None:
    route = open_route(str(tiny_route))
    assert route.name == "tiny"
    assert route.conditions == ("summer", "winter")
    assert route["winter"].stems == tuple(str(place) for place in range(12))
    assert route.aligned
    assert route.tolerance is None


def test_conditions_from_route_toml(seasons: Route) -> None:
    assert [traverse.name for traverse in seasons.traverses] == ["feb", "jan", "july"]
    assert seasons.conditions == ("winter", "july")
    assert seasons.tolerance == 2
    assert seasons["jan"].condition == "winter"
    with pytest.raises(RouteError, match=r"'winter' has several traverses \(feb, jan\)"):
        seasons["winter"]
    with pytest.raises(RouteError, match=r"'night'; there are: feb \(winter\), jan \(winter\), july"):
        seasons["night"]


def test_a_condition_with_one_traverse_names_it(seasons: Route) -> None:
    assert seasons.choose(["jan", "july"])["winter"].name == "jan"


def test_choose(seasons: Route) -> None:
    assert [traverse.name for traverse in seasons.choose(["winter"]).traverses] == ["feb", "jan"]
    assert [traverse.name for traverse in seasons.choose(["july", "feb"]).traverses] == ["feb", "july"]
    assert len(seasons.traverses) == 3
    with pytest.raises(RouteError, match="'spring'"):
        seasons.choose(["jan", "spring"])
    with pytest.raises(RouteError, match="no traverse .* was chosen"):
        seasons.choose([])


def test_only_goes_by_the_names_of_traverses(tmp_path: Path) -> None:
    make(tmp_path, a=["1"], b=["1"], winter=["1"])
    (tmp_path / "route.toml").write_text('[traverses.a]\ncondition = "winter"\n')
    route = open_route(tmp_path)
    assert [traverse.name for traverse in route.only(["winter"]).traverses] == ["winter"]
    assert [traverse.name for traverse in route.only(["winter", "a", "a"]).traverses] == ["a", "winter"]
    assert route.only(["a"]).root == tmp_path
    assert len(route.traverses) == 3


def test_only_refuses_what_is_no_traverse(seasons: Route) -> None:
    with pytest.raises(RouteError, match=r"no traverse 'winter'; there are: feb \(winter\), jan \(winter\), july"):
        seasons.only(["jan", "winter"])
    with pytest.raises(RouteError, match="no traverse .* was chosen"):
        seasons.only([])


def test_frames_are_joined_by_stem_in_natural_order(seasons: Route) -> None:
    assert seasons.shared_stems() == ("2", "10")
    assert seasons.choose(["jan", "feb"]).at(["10", "2"])["jan"].stems == ("2", "10")
    assert {traverse.stems for traverse in seasons.at(seasons.shared_stems()).traverses} == {("2", "10")}
    with pytest.raises(RouteError, match="'feb' lacks the frame '1'"):
        seasons.at(["1", "2"])


def test_traverses_without_shared_stems(tmp_path: Path) -> None:
    route = open_route(make(tmp_path, a=["1"], b=["2"]))
    assert not route.aligned
    assert route.shared_stems() == ()


def test_name_of_a_relative_route(tiny_route: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tiny_route)
    assert open_route(".").name == "tiny"


def test_equal_stems_that_are_not_equal_places(tmp_path: Path) -> None:
    make(tmp_path, a=["1", "2"], b=["1", "2", "3"])
    (tmp_path / "route.toml").write_text("aligned = false\n")
    route = open_route(tmp_path)
    assert not route.aligned
    assert route.shared_stems() == ()
    assert route.why_not_aligned == "are not aligned, as route.toml says (aligned = false)"
    assert route.choose(["b"]).shared_stems() == ("1", "2", "3")
    (tmp_path / "route.toml").write_text("aligned = true\n")
    assert open_route(tmp_path).shared_stems() == ("1", "2")


def test_traverses_with_the_same_stems(tmp_path: Path) -> None:
    route = open_route(make(tmp_path, a=["9", "10"], b=["10", "9"]))
    assert route.shared_stems() == ("9", "10")
    assert route.aligned


def test_a_route_lists_its_traverses_and_knows_names_and_conditions(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "1.png").touch()
    (tmp_path / "route.toml").write_text("[traverses.b]\ncondition = 'night'\n")
    route = open_route(tmp_path)
    assert list(route) == ["a", "b"]
    assert len(route) == 2
    assert all(name in route for name in ("a", "b", "night"))
    assert "c" not in route
    assert repr(route) == f"Route({tmp_path}: a (1), b (1))"
    assert repr(route["b"]) == "Traverse(b, night: 1 frames)"


def test_a_route_says_where_its_truth_came_from_if_it_knows(tiny_route: Path) -> None:
    assert (open_route(tiny_route).truth_origin, open_route(tiny_route).aligned_by) == (None, None)
    (tiny_route / "route.toml").write_text('truth_from = "pairs set by hand"\naligned_by = "hog"\n')
    route = open_route(tiny_route).choose(["summer"])
    assert (route.truth_origin, route.aligned_by) == ("pairs set by hand", "hog")
