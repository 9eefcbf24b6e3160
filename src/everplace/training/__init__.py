"""Training on Lightning: configuration, frames, the module, validation by retrieval, and exact resuming."""
