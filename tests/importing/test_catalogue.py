from __future__ import annotations

import re
from urllib.parse import urlsplit

import pytest

from everplace.errors import ConfigError
from everplace.importing.catalogue import DATA_SETS, DataSet, find_data_set
from everplace.importing.kinds import source_kinds

fetchable = [data_set for data_set in DATA_SETS if not data_set.unavailable]


def test_names_are_unique() -> None:
    names = [data_set.name for data_set in DATA_SETS]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[a-z0-9-]+", name) for name in names)


@pytest.mark.parametrize("data_set", DATA_SETS, ids=lambda data_set: data_set.name)
def test_each_says_what_may_be_done_with_it_and_whom_to_cite(data_set: DataSet) -> None:
    assert data_set.summary
    assert data_set.licence
    assert data_set.citation
    assert bool(data_set.unavailable) != bool(data_set.files or data_set.hub)


@pytest.mark.parametrize("data_set", fetchable, ids=lambda data_set: data_set.name)
def test_addresses_and_hashes_are_well_formed(data_set: DataSet) -> None:
    assert find_data_set(data_set.name) is data_set
    assert data_set.kind
    for file in data_set.files:
        assert urlsplit(file.url).scheme == "https"
        assert urlsplit(file.url).path.endswith(f"/{file.name}")
        assert file.sha256 is None or re.fullmatch("[0-9a-f]{64}", file.sha256)


@pytest.mark.parametrize("data_set", fetchable, ids=lambda data_set: data_set.name)
def test_what_can_be_fetched_can_be_imported(data_set: DataSet) -> None:
    assert data_set.kind in source_kinds()


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("kaist", "sites .* do not answer any more; ask its authors"),
        ("ms2", "by a form: https://sites.google.com/view/multi-spectral-stereo-dataset"),
        ("nordland-videos", "https://nrkbeta.no/2013/01/15/"),
    ],
)
def test_what_cannot_be_fetched_says_where_to_ask(name: str, where: str) -> None:
    with pytest.raises(ConfigError, match=f"{name} cannot be fetched: .*{where}"):
        find_data_set(name)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="no data set 'oxford' to fetch; choose one of nordland64, nordland, "):
        find_data_set("oxford")
