"""Numbers of things in sentences."""


def counted(n: int, what: str) -> str:
    """`1 scan`, `2 scans`: how many of something there are, with its name in the singular."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
