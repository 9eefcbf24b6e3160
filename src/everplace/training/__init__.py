"""From a route to a run: configuration, frames, the step, the loop, validation by retrieval, exact resuming."""
