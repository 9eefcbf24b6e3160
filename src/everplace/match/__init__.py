"""Compares descriptors: similarity, standardisation, sequences, the best matches of each query and their files."""
