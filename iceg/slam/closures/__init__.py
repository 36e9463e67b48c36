"""Loop closures: where to look for them, how they are matched and judged, and the record of all that were tried."""
