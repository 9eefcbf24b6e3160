r"""FAB-MAP's probabilities: how likely an observation is at a place that was seen before, and at a new one.

Cummins and Newman, "FAB-MAP: Probabilistic Localization and Mapping in the Space of Appearance", IJRR 27(6), 2008. An
observation Z is a vector of words z_q, 0 or 1. A place L is known by one observation of it, l. Behind each word stands
a feature e_q of the world that either exists or not, which the detector sees or misses. With the Chow-Liu tree's
parents pa(q):

    p(Z | L) = Π_q p(z_q | z_pa(q), L)                                          the root has no parent
    p(z_q | z_pa(q), L) = Σ_s p(z_q | e_q = s, z_pa(q)) p(e_q = s | L)           s = 0, 1
    p(z_q | e_q, z_pa(q)) = b / (a + b)
        a = p(z_q)     p(not z_q | e_q) p(not z_q | z_pa(q))
        b = p(not z_q) p(z_q | e_q)     p(z_q | z_pa(q))
    p(e_q = 1 | L) = p(l_q | e_q = 1) p(e_q = 1) / Σ_s p(l_q | e_q = s) p(e_q = s)     Bayes' rule

The place enters each factor by its own bit l_q alone, so with A_q(l) = log p(z_q | z_pa(q), l_q = l)

    log p(Z | L) = Σ_q A_q(0) + Σ_q l_q (A_q(1) - A_q(0)):

for one observation it is affine in the place's word vector, and all observations against all places are one matrix
product. At a new place each feature exists with its prior probability (mean field), or the likelihood is the mean over
sampled training frames taken as places.

Constants as in openFABMAP (Glover et al., ICRA 2012): p(z=1|e=1) = 0.39, p(z=1|e=0) = 0; the prior p(e_q = 1) is the
word's frequency p(z_q = 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.fabmap.chow_liu import ChowLiuTree

__all__ = ["SEEN_IF_NOT_THERE", "SEEN_IF_THERE", "Observations", "observe", "sampled_new_place"]

SEEN_IF_THERE, SEEN_IF_NOT_THERE = 0.39, 0.0
"""The detector: p(z=1|e=1) and p(z=1|e=0)."""


@dataclass(frozen=True, eq=False)
class Observations:
    """M observations, as functions of the place where they may have been made.

    Attributes:
        coefficients: M×W float64, A_q(1) - A_q(0): what a word of the place adds to the log-likelihood.
        nowhere: (M,) float64, Σ A_q(0): the log-likelihood at a place where no word was seen.
        new_place: (M,) float64, the log-likelihood at a new place by mean field.
    """

    coefficients: NDArray[np.float64]
    nowhere: NDArray[np.float64]
    new_place: NDArray[np.float64]

    def log_likelihood(self, places: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Log p(Z|L) in nats: places N×W to M×N."""
        likelihood: NDArray[np.float64] = self.coefficients @ places.T.astype(np.float64) + self.nowhere[:, None]
        return likelihood


def observe(tree: ChowLiuTree, words: NDArray[np.bool_]) -> Observations:
    """Prepares observations for any number of places.

    Args:
        tree: How words occur together.
        words: M×W.
    """
    given_feature = [_seen_as_is(tree, words, likelihood) for likelihood in (SEEN_IF_NOT_THERE, SEEN_IF_THERE)]

    def log_seen(exists: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.log((1.0 - exists) * given_feature[0] + exists * given_feature[1])

    absent, present = (log_seen(_existence(tree.present, seen)) for seen in (False, True))
    return Observations(present - absent, absent.sum(axis=1), log_seen(tree.present).sum(axis=1))


def sampled_new_place(observations: Observations, sample: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Log-likelihood at a new place as the mean over sampled frames of the world, taken as places.

    Args:
        observations: M of them.
        sample: S×W words of frames that are places of their own.

    Returns:
        (M,) in nats.
    """
    likelihood = observations.log_likelihood(sample)
    top = likelihood.max(axis=1)
    mean: NDArray[np.float64] = top + np.log(np.exp(likelihood - top[:, None]).mean(axis=1))
    return mean


def _seen_as_is(tree: ChowLiuTree, words: NDArray[np.bool_], detected: float) -> NDArray[np.float64]:
    """p(z_q | e_q, z_pa(q)) of what was seen, M×W, where the detector fires with probability `detected`."""
    seen = np.where(words, detected, 1.0 - detected)
    prior = np.where(words, tree.present, 1.0 - tree.present)
    conditional = tree.conditional(words)
    conditional = np.where(words, conditional, 1.0 - conditional)
    b = (1.0 - prior) * seen * conditional
    a = prior * (1.0 - seen) * (1.0 - conditional)
    return b / (a + b)


def _existence(prior: NDArray[np.float64], seen: bool) -> NDArray[np.float64]:
    """p(e_q = 1 | L) of a place where the word was seen, or not."""
    there = SEEN_IF_THERE if seen else 1.0 - SEEN_IF_THERE
    not_there = SEEN_IF_NOT_THERE if seen else 1.0 - SEEN_IF_NOT_THERE
    return there * prior / (there * prior + not_there * (1.0 - prior))
