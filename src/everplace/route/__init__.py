"""A route on disk and in memory: traverses of frames, which of them take part, which show the same place."""
