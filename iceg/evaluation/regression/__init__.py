"""One table over everything there is to run: what is lost or gained by a change, and whether that is chance."""
