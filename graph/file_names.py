"""Names of files as text that can be written anywhere."""


def readable(text: str) -> str:
    r"""Text without what no file can hold: bytes of a name that are not UTF-8 become `\xfc` and the like.

    A name that is UTF-8 comes out as it is, also where the locale made Python read it as bytes (`LC_ALL=POSIX`).

    Args:
        text: may hold names as Python gives them, bytes it could not decode as lone surrogates (PEP 383).
    """
    try:
        content = text.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:  # surrogates that stand for no byte
        content = text.encode("utf-8", "backslashreplace")
    return content.decode("utf-8", "backslashreplace")
