"""Strict decoding of image files: always the same kind of array, or one error that names the file."""
