"""Says how good a method is: from a route, two traverses and a method to scores."""
