"""One module a method: its name is the method's name, and its `open_method(argument)` returns the describer.

The registry finds every module here, so adding a method is adding a file. A module that needs something from the net
fetches it in `prepare(argument, progress)`, which the registry calls first; `open_method` downloads nothing.
"""
