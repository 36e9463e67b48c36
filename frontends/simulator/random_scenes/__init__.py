"""Worlds, routes, lasers and wheels drawn at random, twelve kinds of places; the same seed draws the same ones."""
