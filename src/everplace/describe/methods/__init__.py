"""One module a method: its name is the method's name, and its `open_method(argument)` returns the describer.

The registry finds every module here, so adding a method is adding a file.
"""
