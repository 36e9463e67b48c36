"""The maps: landmarks and occupancy, both anchored to the trajectory."""
