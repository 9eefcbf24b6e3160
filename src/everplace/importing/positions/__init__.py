"""From positions of any kind to x, y and heading, and to the places that several drives share."""
