"""Names of files as text that can be written anywhere."""


def readable(name: str) -> str:
    r"""A name without what no text can hold: bytes that are not UTF-8 become `\xfc` and the like.

    A name that is UTF-8 comes out as it is, also where the locale made Python read it as bytes (`LC_ALL=POSIX`).

    Args:
        name: as Python gives it, bytes it could not decode as lone surrogates (PEP 383).
    """
    try:
        content = name.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:  # surrogates that stand for no byte
        content = name.encode("utf-8", "backslashreplace")
    return content.decode("utf-8", "backslashreplace")
