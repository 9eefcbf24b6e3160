"""What adapts a descriptor to a route in closed form: oriented gradients, and the discriminant of places."""
