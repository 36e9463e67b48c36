"""Where the path may be broken, and recognising the place again without the path."""
