"""Compares descriptors: similarity, standardisation, best matches and the files for them."""
