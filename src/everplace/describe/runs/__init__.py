"""Describers of run directories: a kind of model is opened by the module of its name here, else by `trained`."""
