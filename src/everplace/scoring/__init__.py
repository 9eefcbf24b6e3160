"""Says how good a method is: scores of a similarity matrix against the truth, and what its code leaks."""
