"""Strategies compared on views whose every outcome is known."""
