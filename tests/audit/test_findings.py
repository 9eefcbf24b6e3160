"""What an audit means: each verdict for numbers that can mean nothing else, and the numbers in the sentence."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.audit.findings import condition_finding, divergence_finding, place_finding, swap_finding
from everplace.audit.leakage import Audit, Probe, SwapError

HEALTHY = Audit(
    condition_from_z_p=Probe(0.49, 0.51, 0.5),
    condition_from_z_c=Probe(0.99, 0.98, 0.5),
    recall_at_1={"z_p": 0.7, "z_c": 0.02, "z": 0.68},
    recall_chance=0.01,
    swap=SwapError(mean_z_c=0.010, same_place_z_c=0.0098, other_place_z_c=0.0102, unchanged=0.04, mean_image=0.03),
    active_dimensions={"z_p": 60, "z_c": 12},
    kl={"z_p": 80.0, "z_c": 9.0},
    kl_per_dimension={"z_p": [1.0] * 96, "z_c": [0.3] * 32},
    places=300,
    frames=600,
    divided=True,
    tolerance=1,
)


def probes(z_p: float, z_c: float, chance: float = 0.5) -> Audit:
    return replace(
        HEALTHY,
        condition_from_z_p=Probe(0.0, z_p, chance),
        condition_from_z_c=Probe(z_c, 0.0, chance),
    )


def recalls(z_p: float, z_c: float) -> Audit:
    return replace(HEALTHY, recall_at_1={"z_p": z_p, "z_c": z_c, "z": max(z_p, z_c)})


def test_a_healthy_audit_is_healthy_in_every_part_and_says_its_numbers() -> None:
    found = [part(HEALTHY) for part in (condition_finding, place_finding, divergence_finding, swap_finding)]
    assert [one.verdict for one in found if one is not None] == ["healthy"] * 4
    condition, place, divergence, swap = map(str, found)
    assert condition == (
        "Healthy: on places it has not seen, the better probe tells the condition from z_p for 51.0 % of the frames "
        "and from z_c for 99.0 % (chance: 50.0 %), so the condition is in z_c and not in z_p."
    )
    assert "70.0 % of the frames by z_p, 2.0 % by z_c and 68.0 % by both (chance: 1.0 %)" in place
    assert "60 of the 96 dimensions of z_p are active and hold 80.0 nats a frame, 12 of the 32 of z_c" in divergence
    assert "takes 5.7 nats" in divergence  # ln 300
    assert "0.0100 with that condition's mean z_c" in swap
    assert "(the frame unchanged: 0.0400, the mean image: 0.0300)" in swap


@pytest.mark.parametrize(
    ("z_p", "z_c", "verdict", "says"),
    [
        (0.95, 0.99, "leak", "z_p holds the condition as well"),
        (0.751, 1.0, "leak", "z_p holds the condition as well"),
        (0.749, 1.0, "slight leak", "some of the condition leaks into z_p"),
        (0.579, 1.0, "slight leak", "some of the condition leaks into z_p"),
        (0.53, 1.0, "healthy", "in z_c and not in z_p"),
        (0.97, 0.5, "wrong block", "in z_p instead of z_c"),
        (0.5, 0.48, "absent", "neither block"),
        (0.5, 0.65, "weak", "holds only some of it"),
    ],
)
def test_where_the_condition_is(z_p: float, z_c: float, verdict: str, says: str) -> None:
    found = condition_finding(probes(z_p, z_c))
    assert found is not None
    assert found.verdict == verdict
    assert says in found.sentence


def test_few_frames_prove_no_leak_of_the_condition() -> None:
    found = [condition_finding(replace(probes(0.61, 1.0), frames=frames)) for frames in (40, 4000)]
    assert [one.verdict for one in found if one is not None] == ["healthy", "slight leak"]


def test_chance_is_the_most_frequent_condition_and_not_one_half() -> None:
    found = condition_finding(probes(0.68, 0.99, chance=2 / 3))
    assert found is not None
    assert found.verdict == "healthy"
    assert "(chance: 66.7 %)" in found.sentence


@pytest.mark.parametrize(
    ("z_p", "z_c", "verdict", "says"),
    [
        (0.01, 0.6, "shortcut", "z_c carries the place and z_p holds none of it"),
        (0.4, 0.6, "shortcut", "z_c carries the place and z_p holds no more of it"),
        (0.7, 0.12, "slight leak", "z_c carries some of it too"),
        (0.7, 0.5, "leak", "z_c carries much of it too"),
        (0.7, 0.06, "healthy", "in z_p and not in z_c"),
        (0.012, 0.008, "absent", "neither block alone"),
        (0.0, 0.0, "absent", "neither block alone"),
    ],
)
def test_where_the_place_is(z_p: float, z_c: float, verdict: str, says: str) -> None:
    found = place_finding(recalls(z_p, z_c))
    assert found.verdict == verdict
    assert says in found.sentence


@pytest.mark.parametrize(
    ("active", "kl", "verdict", "says"),
    [
        ((0, 12), (0.3, 9.0), "collapsed", "z_p is empty"),
        ((0, 0), (0.1, 0.1), "collapsed", "both blocks are empty"),
        ((60, 0), (80.0, 0.1), "collapsed", "z_p is alive, but z_c has collapsed: z_c is empty"),
        # ln 2 = 0.69 nats tell two conditions apart, whatever the dimensions that they are spread over.
        (
            (96, 5),
            (17.9, 0.2),
            "collapsed",
            "z_p is alive, but z_c has collapsed: z_c cannot tell the conditions apart",
        ),
        ((96, 32), (17.9, 0.69), "collapsed", "which takes 0.7 nats at least"),
        ((96, 5), (17.9, 0.7), "healthy", "z_p is alive"),
        ((18, 6), (0.7, 0.3), "collapsed", "takes 5.7 nats at least, and z_c cannot tell the conditions apart"),
        ((18, 0), (0.7, 0.0), "collapsed", "takes 5.7 nats at least, and z_c is empty"),
        ((3, 12), (4.0, 9.0), "collapsed", "cannot tell 300 places apart, which takes 5.7 nats"),
        ((5, 12), (9.0, 9.0), "narrow", "most of it is unused"),
        ((60, 12), (5.8, 9.0), "healthy", "z_p is alive"),
    ],
)
def test_whether_the_latent_is_alive(active: tuple[int, int], kl: tuple[float, float], verdict: str, says: str) -> None:
    audit = replace(
        HEALTHY,
        active_dimensions=dict(zip(("z_p", "z_c"), active, strict=True)),
        kl=dict(zip(("z_p", "z_c"), kl, strict=True)),
    )
    found = divergence_finding(audit)
    assert found.verdict == verdict
    assert says in found.sentence


@pytest.mark.parametrize(
    ("mean", "same", "other", "verdict", "says"),
    [
        (0.010, 0.009, 0.030, "leak", "from z_p, but much of it from z_c"),
        (0.010, 0.010, 0.0149, "slight leak", "from z_p, but some of it from z_c"),
        (0.035, 0.009, 0.060, "shortcut", "from z_c and not from z_p"),
        (0.031, 0.0305, 0.031, "no translation", "the mean image comes at least as near"),
        (0.035, 0.031, 0.060, "no translation", "comes from z_c too"),
        (0.029, 0.0295, 0.029, "healthy", "comes from z_p"),
    ],
)
def test_where_a_decoded_picture_has_its_place_from(
    mean: float, same: float, other: float, verdict: str, says: str
) -> None:
    found = swap_finding(replace(HEALTHY, swap=SwapError(mean, same, other, unchanged=0.04, mean_image=0.03)))
    assert found is not None
    assert found.verdict == verdict
    assert says in found.sentence


@pytest.mark.parametrize(("chance", "nats", "verdict"), [(0.9, 0.2, "healthy"), (0.25, 1.3, "collapsed")])
def test_the_conditions_that_there_are_say_what_z_c_needs(chance: float, nats: float, verdict: str) -> None:
    found = divergence_finding(replace(probes(chance, 1.0, chance), kl={"z_p": 80.0, "z_c": nats}))
    assert found.verdict == verdict


def test_one_condition_needs_no_z_c() -> None:
    alone = replace(HEALTHY, condition_from_z_p=None, condition_from_z_c=None, kl={"z_p": 80.0, "z_c": 0.1})
    assert divergence_finding(alone).verdict == "healthy"


def test_the_nearer_baseline_is_named() -> None:
    found = swap_finding(replace(HEALTHY, swap=SwapError(0.03, 0.03, 0.03, unchanged=0.02, mean_image=0.05)))
    assert found is not None
    assert "the frame unchanged comes at least as near" in found.sentence


def test_one_condition_has_nothing_to_find() -> None:
    alone = replace(HEALTHY, condition_from_z_p=None, condition_from_z_c=None, swap=None)
    assert condition_finding(alone) is None
    assert swap_finding(alone) is None


SHARE = st.floats(0.0, 1.0)
ERROR = st.floats(0.0, 1.0)


@settings(max_examples=40, deadline=None)
@given(SHARE, SHARE, st.floats(0.2, 0.9), SHARE, SHARE, st.tuples(ERROR, ERROR, ERROR, ERROR, ERROR))
def test_every_measurement_has_a_meaning_that_does_not_contradict_it(
    p: float, c: float, chance: float, by_z_p: float, by_z_c: float, errors: tuple[float, ...]
) -> None:
    audit = replace(probes(p, c, chance), recall_at_1={"z_p": by_z_p, "z_c": by_z_c, "z": by_z_p})
    audit = replace(audit, swap=SwapError(*errors))
    condition, place, swap = condition_finding(audit), place_finding(audit), swap_finding(audit)
    assert condition is not None
    assert swap is not None
    assert (condition.verdict in ("slight leak", "leak", "wrong block")) <= (p > chance)
    assert (condition.verdict == "healthy") <= (c > chance)
    assert (place.verdict in ("healthy", "slight leak", "leak")) <= (by_z_p > by_z_c)
    assert (place.verdict == "shortcut") <= (by_z_c >= by_z_p)
    assert (swap.verdict in ("healthy", "slight leak", "leak")) == (errors[0] < min(errors[3:]))
