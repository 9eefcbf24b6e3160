"""The rendered route: a small procedural world, driven through once per condition.

A road winds through forests, fields, villages and past lakes. Where things stand and what shape they have depends on
the seed alone; what they look like depends on the condition (season, light, weather). The route is drawn to look like
a route, and serves where no recorded one is at hand: the demo, the tests, the first steps.

`everplace.render.rendered_route.render_route` writes a whole route, `everplace.render.frame.Drive` renders single
frames.
"""
