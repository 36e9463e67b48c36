"""Where the path may be broken, and finding the place again by its looks alone."""
