"""Loop closures: where to look for them, the local maps that they match, and the record of all that were tried."""
