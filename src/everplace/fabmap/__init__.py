"""FAB-MAP: vocabulary, Chow-Liu tree, likelihood of an observation, posterior over places."""
