"""Compares descriptors: similarity, standardisation, sequences, best matches and the files for them."""
