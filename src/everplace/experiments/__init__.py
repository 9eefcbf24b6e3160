"""Whole studies made of the rooms below: one evaluation, a comparison of methods, the demo."""
