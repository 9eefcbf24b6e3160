"""Turns images into descriptors: every method behind one protocol, one file a method, one file format.

`protocol` says what a method is, `registry` opens one by its name, `pipeline` runs one over a traverse, and
`descriptors` holds, writes and reads what comes out (`hdf5` is how, `hloc_layout` another layout).
"""
