"""The HTTP service over a map: answers frames, shows the map, and holds under load and ill will."""
