"""Stands for a process that is killed while it compiles: it ends without a word."""
