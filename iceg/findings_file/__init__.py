"""`run.npz`: what a run has found, from which it can be concluded anew."""
