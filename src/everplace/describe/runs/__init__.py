"""Describers of run directories, one module a kind of fitted model."""
