"""Which frames of two drives show the same place: the path of one along the other, how sure it is, and the route."""
