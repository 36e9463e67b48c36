"""Changes to an input that its reader's grammar knows: numbers, words, lines, nesting, encodings, single bytes."""

import random
import re
from collections.abc import Callable

NASTY = (
    *b"0 -0 -1 1 2 0.5 1e-300 -1e-300 5e-324 1e-320 1e-9 1e6 1e9 1e15 -1e15 1e19 1e150 1e300 -1e300 1e308".split(),
    *b"1e999 -1e999 nan NaN inf -inf Infinity 2147483648 9223372036854775808 18446744073709551616".split(),
    *b"1e 0x10 1_000 1,5 --1 +1 . 99999 100001 true 3.14159265 360 57.29578 \xd9\xa3".split(),
    *(b"", b"1" + b"0" * 30, b"9" * 400, b"9" * 5000),
)
"""Numbers that readers trip over: huge, tiny, none, of another kind."""

_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[^\s,;=\[\]{}<>\"']+")
_NESTS = ((b"[", b"]"), (b"{", b"}"), (b"{'a':", b"}"), (b"<g>", b"</g>"), (b"(", b")"), (b'"', b'"'), (b"[a.", b"]"))
_STRANGE = (
    *(b"\0", b"\xff", b"\xef\xbb\xbf", b"\r", b"\x0b", b"\x1a", b"\xc3\xbc", b"\xe2\x80\xa8"),
    *(b"#", b"\\", b"/dev/zero"),
)

Mutation = Callable[[bytes, random.Random], bytes]


def mutate(content: bytes, rng: random.Random) -> bytes:
    """One to four changes; of them numbers most often."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        content = rng.choices(_MUTATIONS, _WEIGHTS)[0](content, rng)
    return content


def mutate_lines(content: bytes, rng: random.Random) -> bytes:
    """A change to nearly every line, for readers that go on after a bad one."""
    return b"\n".join(
        rng.choices(_MUTATIONS, _LINE_WEIGHTS)[0](line, rng) if rng.random() < 0.9 else line
        for line in content.split(b"\n")
    )


def _number(content: bytes, rng: random.Random) -> bytes:
    return _replaced(_NUMBER, content, rng, lambda _: rng.choice(NASTY))


def _scaled(content: bytes, rng: random.Random) -> bytes:
    """A number that is only somewhat wrong."""
    factor = rng.choice((-1.0, 1e-3, 0.5, 1.01, 2.0, 57.3, 1e3, 1e6))

    def scaled(word: bytes) -> bytes:
        value = float(word) * factor
        return f"{value:.6g}".encode()

    return _replaced(_NUMBER, content, rng, scaled)


def _word(content: bytes, rng: random.Random) -> bytes:
    """A word left out, said twice, or replaced by another of the same input."""
    kind = rng.randrange(3)
    words = [b"x"]
    if kind == 2:
        near = content[_start(content, rng) :][:5000]
        words = _WORD.findall(near) or words
    return _replaced(_WORD, content, rng, lambda word: (b"", word + b" " + word, rng.choice(words))[kind])


def _line(content: bytes, rng: random.Random) -> bytes:
    """A line left out, repeated, cut, joined to the next, or moved."""
    lines = content.split(b"\n")
    at = rng.randrange(len(lines))
    kind = rng.randrange(6)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines[at:at] = [lines[at]] * rng.choice((1, 1, 2, 20))
    elif kind == 2:
        lines[at] = lines[at][: rng.randrange(len(lines[at]) + 1)]
    elif kind == 3 and at + 1 < len(lines):
        lines[at : at + 2] = [lines[at] + lines[at + 1]]
    elif kind == 4:
        lines.insert(rng.randrange(len(lines)), lines.pop(at))
    else:
        return content[: rng.randrange(len(content) + 1)]
    return b"\n".join(lines)


def _bytes(content: bytes, rng: random.Random) -> bytes:
    """Some bytes changed."""
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        if changed:
            changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def _inserted(content: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice((*_STRANGE, *NASTY)) + content[at:]


def _nested(content: bytes, rng: random.Random) -> bytes:
    """Something nested deep."""
    opening, closing = rng.choice(_NESTS)
    depth = rng.choice((1, 2, 30, 3000))
    start = rng.randrange(len(content) + 1)
    end = min(len(content), start + rng.choice((0, 1, 10, 100)))
    return content[:start] + opening * depth + content[start:end] + closing * depth + content[end:]


def _encoded(content: bytes, rng: random.Random) -> bytes:
    encoding = rng.choice(("utf-16", "utf-32", "utf-8-sig", "cp037"))
    return content.decode("latin-1").encode(encoding, "replace")


def _replaced(pattern: re.Pattern[bytes], content: bytes, rng: random.Random, new: Callable[[bytes], bytes]) -> bytes:
    """One match replaced; looked for from somewhere on, so that long inputs cost no more."""
    found = pattern.search(content, _start(content, rng)) or pattern.search(content)
    return content if found is None else content[: found.start()] + new(found.group()) + content[found.end() :]


def _start(content: bytes, rng: random.Random) -> int:
    """Anywhere; often near the start of a line, where the fields are that matter."""
    at = rng.randrange(len(content) + 1)
    if rng.random() < 0.6:
        begin = content.rfind(b"\n", 0, at) + 1
        return min(len(content), begin + rng.randrange(80))
    if rng.random() < 0.5:
        end = content.find(b"\n", at)
        return max(0, (end if end >= 0 else len(content)) - rng.randrange(120))
    return at


_MUTATIONS: tuple[Mutation, ...] = (_number, _scaled, _word, _line, _bytes, _inserted, _nested, _encoded)
_WEIGHTS = (40, 12, 12, 12, 10, 8, 5, 1)
_LINE_WEIGHTS = (40, 15, 12, 0, 12, 8, 2, 0)
