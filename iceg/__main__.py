"""`python -m iceg` is `iceg`."""

from iceg.cli import command

command()
