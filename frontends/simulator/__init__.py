"""Worlds of walls and furniture, a robot driven through them, and the log with truth that its laser records."""
