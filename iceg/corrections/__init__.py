"""What a person corrects of a run: closures forbidden, added and pinned, scans left out, the map turned."""
