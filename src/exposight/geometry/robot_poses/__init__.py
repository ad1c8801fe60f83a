"""Poses as robots and programs write them, and the chain of flange, hand-eye and part."""
