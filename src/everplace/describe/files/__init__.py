"""Descriptors in memory and on disk: everplace's HDF5 file and hloc's layout."""
