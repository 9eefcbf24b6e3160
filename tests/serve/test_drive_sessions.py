"""Sessions live as long as they are used, and no longer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from everplace.mapping.localizer import Localizer
from everplace.serve.drive_sessions import DriveSessions
from everplace.serve.refusal import RefusedError
from everplace.serve.service_limits import DEFAULT_LIMITS

BYTES = 60 * 10 * 96
"""Of the filter of the road's 60 places."""


@pytest.fixture(scope="module")
def localizer(unchanged_summer_map: Path) -> Localizer:
    return Localizer(unchanged_summer_map)


class Clock:
    now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_a_map_that_has_become_another_lets_go_of_the_drives_on_the_earlier_one(localizer: Localizer) -> None:
    sessions = DriveSessions(DEFAULT_LIMITS)
    for name in ("one", "two"):
        sessions.take(name, localizer, 2)
    for version in (3, 1):  # made anew, a map has lower numbers than before
        other = localizer.another(1)
        newer = sessions.take("one", other, version)
        assert newer.version == version
        assert len(sessions) == 1
        assert sessions.take("one", other, version) is newer


def test_a_session_is_found_again_with_what_it_knows(localizer: Localizer) -> None:
    sessions = DriveSessions(DEFAULT_LIMITS)
    one = sessions.take("one", localizer, 1)
    one.localizer.observe(np.zeros((8, 8), np.uint8))
    assert sessions.take("one", localizer, 1) is one
    assert sessions.take("other", localizer, 1) is not one
    assert len(one.localizer.state()) == 1
    assert len(sessions.take("other", localizer, 1).localizer.state()) == 0
    assert len(localizer.state()) == 0
    assert len(sessions) == 2


def test_another_version_of_the_map_begins_it_anew(localizer: Localizer) -> None:
    sessions = DriveSessions(DEFAULT_LIMITS)
    one = sessions.take("one", localizer, 1)
    assert sessions.take("one", localizer.another(1), 2) is not one
    assert len(sessions) == 1


@pytest.mark.parametrize("limits", [{"sessions": 3}, {"session_bytes": 3 * BYTES}, {"session_bytes": 4 * BYTES - 1}])
def test_the_least_recently_used_one_goes(localizer: Localizer, limits: dict[str, int]) -> None:
    sessions = DriveSessions(replace(DEFAULT_LIMITS, **limits))
    kept = {name: sessions.take(name, localizer, 1) for name in "abc"}
    sessions.take("a", localizer, 1)
    sessions.take("d", localizer, 1)
    assert len(sessions) == 3
    assert sessions.take("a", localizer, 1) is kept["a"]
    assert sessions.take("c", localizer, 1) is kept["c"]
    assert sessions.take("b", localizer, 1) is not kept["b"]


def test_one_session_lives_however_large_the_map(localizer: Localizer) -> None:
    sessions = DriveSessions(replace(DEFAULT_LIMITS, session_bytes=1))
    one = sessions.take("one", localizer, 1)
    assert sessions.take("one", localizer, 1) is one


def test_what_is_not_heard_of_is_forgotten(localizer: Localizer) -> None:
    clock = Clock()
    sessions = DriveSessions(replace(DEFAULT_LIMITS, session_seconds=60), clock)
    one, two = sessions.take("one", localizer, 1), sessions.take("two", localizer, 1)
    clock.now += 50
    assert sessions.take("one", localizer, 1) is one
    clock.now += 20
    assert len(sessions) == 1
    assert sessions.take("one", localizer, 1) is one
    assert sessions.take("two", localizer, 1) is not two


def test_a_session_is_ended_once(localizer: Localizer) -> None:
    sessions = DriveSessions(DEFAULT_LIMITS)
    sessions.take("one", localizer, 1)
    assert [sessions.end("one"), sessions.end("one"), sessions.end("none")] == [True, False, False]


def test_no_more_frames_of_one_drive_wait_than_the_limit(localizer: Localizer) -> None:
    sessions = DriveSessions(replace(DEFAULT_LIMITS, session_waiting=2))
    one, two = sessions.take("one", localizer, 1), sessions.take("two", localizer, 1)
    with sessions.entered(one), sessions.entered(one):
        with pytest.raises(RefusedError) as refused, sessions.entered(one):
            pass
        assert refused.value.status == 503
        with sessions.entered(two):
            pass
    with sessions.entered(one):
        assert one.waiting == 1
