"""One module a method: to add a method, add `NAME.py` here; its name is the method's name.

It holds a subclass of `everplace.describe.describer.Describer` with `method`, `image`, `dimension` and the two methods
`settings` and `describe_batch`, and a function `open_method(argument)` that returns one of it; `argument` is what a
user writes after `NAME:`, else empty. What has to be downloaded first is fetched in `prepare(argument, progress)`, if
there is one: `open_method` downloads nothing. A module whose name begins with an underscore is no method.
"""
