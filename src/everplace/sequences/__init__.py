"""The hidden Markov model of a drive along a route: filter, smoothing and best path; SeqSLAM's search beside it."""
