"""Turns images into descriptors: one base class for every method, one file a method, one file format.

`describer` says what a method is and does the describing, `registry` opens one by its name, `methods` and `runs` hold
them, `files` holds, writes and reads what comes out, and `costs` measures what a method needs.
"""
