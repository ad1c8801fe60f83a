"""Captures in many views that serve a part's features: the program, and how it is solved."""
