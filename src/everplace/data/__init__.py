"""The data room: routes on disk, ground truth, decoding, packing and augmentation.

A `Route` holds `Traverse`s, a traverse holds `Frame`s; frames of different traverses are joined by stem.
Images are decoded strictly (`images`), packed once into a memory-mapped cache (`pack`), chosen and filtered
(`selection`), and told apart by `truth`. Formats other than a directory of images live in `sources`, one file
each.
"""
