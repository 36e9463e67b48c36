"""Floor plans."""

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from tests.fuzz.cases.case import LONG, Case
from tests.fuzz.seeds import world


def _plan(name: str, file: str, content: Callable[[], bytes]) -> Case:
    def make(folder: Path) -> None:
        (folder / file).write_bytes(content())
        (folder / "x.world").write_text(world(f"plan {file}"))

    return Case(name=f"plan {name}", words=("simulate", "x.world", "-o", "out"), make=make)


def plans() -> Iterator[Case]:
    """Floor plans in a world."""
    deep = "<svg>" + "<g>" * 3000 + '<line x2="1" y2="1"/>' + "</g>" * 3000 + "</svg>"
    for name, text in {
        "unknown encoding": "<?xml version='1.0' encoding='klingon'?><svg/>",
        "multi-byte encoding": "<?xml version='1.0' encoding='shift_jis'?><svg/>",
        "UTF-7": "<?xml version='1.0' encoding='utf-7'?><svg/>",
        "3,000 groups deep": deep,
        "1e300": '<svg><line x2="1e300" y2="1"/></svg>',
        "1e999": '<svg><line x2="1e999" y2="1"/></svg>',
        "arc of a tiny radius": '<svg><path d="M0 0A1e-300 1e-300 0 0 0 5 5"/></svg>',
        "arc of a huge radius": '<svg><path d="M0 0A1e300 1e300 0 0 0 5 5"/></svg>',
        "scale nested": "<svg>" + '<g transform="scale(1e200)">' * 3 + '<line x2="1"/>' + "</g>" * 3 + "</svg>",
        "skew by 90°": '<svg><g transform="skewX(90)"><line x2="1" y2="1"/></g></svg>',
        "billion laughs": "<!DOCTYPE s [<!ENTITY a 'ha'>"
        + "".join(f"<!ENTITY {b} '{('&' + a + ';') * 10}'>" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
        + "]><svg><line x2='&i;'/></svg>",
        "uses of uses": '<svg><line id="a" x2="1"/>'
        + "".join(
            f'<g id="{b}">' + f'<use href="#{a}"/>' * 10 + "</g>" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
        )
        + "</svg>",
        "4 million strokes": '<svg><path d="M0 0' + "h1" * 3_900_000 + '"/></svg>',
        "no SVG": "<html/>",
        "nothing": "",
        "size": "x" * 9_000_000,
    }.items():
        yield _plan(f"SVG {name}", "p.svg", text.encode)
    for name, content in {
        "P5 alone": b"P5",
        "P2 alone": b"P2",
        "of 5,000 digits": b"P5 " + LONG.encode() + b" 1 255\n\0",
        "of 0 x 0": b"P5 0 0 255\n",
        "of negative size": b"P5 -2 -2 255\n\0\0\0\0",
        "white 0": b"P5 2 2 0\n\0\0\0\0",
        "white 10^12": b"P5 2 2 1000000000000\n\0\0\0\0",
        "a comment without end": b"P5 # no end",
        "nan": b"P2 2 1 255\nnan 1",
        "short": b"P5 5000 5000 255\n\0",
        "of 30,000 x 30,000": b"P5 30000 30000 255\n" + b"\0" * 9,
        "checkerboard": b"P5 2000 2000 1\n" + (b"\0\1" * 1000 + b"\1\0" * 1000) * 1000,
    }.items():
        yield _plan(f"PGM {name}", "p.pgm", partial(bytes, content))
    yield _plan("PNG of 30,000² bits", "p.png", lambda: png(30_000, 30_000, 1, 0))
    yield _plan("PNG of 12,000² RGBA", "p.png", lambda: png(12_000, 12_000, 8, 6))
    yield _plan("PNG of 4,000² RGBA", "p.png", lambda: png(4_000, 4_000, 8, 6))
    yield _plan("PNG of (2^31-1)²", "p.png", lambda: png(2**31 - 1, 2**31 - 1, 1, 0, rows=0))
    yield _plan("PNG cut off", "p.png", lambda: png(100, 100, 8, 6)[:60])
    yield _plan("PNG of 0 x 0", "p.png", lambda: png(0, 0, 8, 6))
    yield _plan("GIF header alone", "p.gif", lambda: b"GIF89a")
    yield _plan("TIFF header alone", "p.tif", lambda: b"II*\0\x08\0\0\0\xff\xff")
    yield _plan("PostScript", "p.eps", lambda: b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\nquit\n")


def png(width: int, height: int, depth: int, colour: int, rows: int | None = None) -> bytes:
    """A black image, its pixels packed a row at a time."""
    row = b"\0" * (1 + (width * depth * (4 if colour == 6 else 1) + 7) // 8) if rows != 0 else b""
    packer = zlib.compressobj(1)
    pixels = io.BytesIO()
    for _ in range(height if rows is None else rows):
        pixels.write(packer.compress(row))
    pixels.write(packer.flush())

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels.getvalue()) + chunk(b"IEND", b"")
