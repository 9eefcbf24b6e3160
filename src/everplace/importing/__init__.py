"""Foreign data to routes: one file a source, the containers they lie in, the positions they bring."""
