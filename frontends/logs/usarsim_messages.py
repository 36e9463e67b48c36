"""The messages of USARSim, line by line.

    SEN {Time 5.2} {Type RangeScanner} {Name Scanner1} {Resolution 0.0174} {FOV 3.1415} {Range r,r,...}
    SEN {Time 5.2} {Type Odometry} {Name Odometry} {Pose x,y,θ}
    SEN {Time 5.2} {Type INS} {Name INS} {Location x,y,z} {Orientation roll,pitch,yaw}            (also GroundTruth)
    CONF {Type RangeScanner} {Name Scanner1} {MaxRange 20.0} {MinRange 0.1} {Resolution 0.0174} {Fov 3.1415}
    GEO {Type RangeScanner} {Name Scanner1 Location x,y,z Orientation roll,pitch,yaw Mount HARD}

`{Time}` may be missing, braces come in any order, keys in any case, and a brace may hold several keys with their
values. Metres and radians. Source: USARSim manual 3.1.3, sections 8 and 9.
"""

import re
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.logs.errors import MalformedLineError
from frontends.logs.number_fields import read_numbers
from frontends.logs.text import Line
from graph.limits import LIMITS

_KIND = re.compile(rb"[A-Za-z][A-Za-z0-9_]*")
_CONTINUES = re.compile(rb"[-+.,0-9]|nan$|inf", re.IGNORECASE)
_FEW = 6  # numbers that are read one by one
_MOST = {"time": LIMITS.stamp, "minrange": LIMITS.range, "maxrange": LIMITS.range, "fov": 360.0, "resolution": 360.0}
"""The most that a number can be, by its key [s, m, ° or rad]."""
_COMMAS_TO_SPACES = bytes.maketrans(b",;", b"  ")


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """One message, or the part of one that is about one sensor.

    Attributes:
        line: where it stands.
        kind: SEN, CONF, GEO and so on, in capitals.
        fields: values by key, keys in small letters; of a key that comes twice the last.
    """

    line: Line
    kind: str
    fields: dict[str, bytes]

    @property
    def type(self) -> str:
        """The type of the sensor, in small letters; empty where the message has none."""
        return self.text("type").lower()

    def text(self, key: str) -> str:
        """A value as text; empty when it is not there."""
        return self.fields.get(key, b"").decode("utf-8", "replace")

    def numbers(self, key: str, count: int | None = None) -> NDArray[np.float64]:
        """A value as (n,) numbers, n = `count` where that is fixed.

        Raises:
            MalformedLineError: the key is missing, or its value is something else.
        """
        if key not in self.fields:
            raise MalformedLineError(f"no {{{key}}}", f"it in a {self.kind} message of type {self.text('type')}")
        value = self.fields[key].translate(_COMMAS_TO_SPACES)
        found = len(value.split())
        if count is not None and found != count:
            raise MalformedLineError(f"{found} numbers in {{{key}}}", f"{count}")
        if found <= _FEW and b"_" not in value:
            with suppress(ValueError):
                return np.array([float(word) for word in value.split()])
        numbers = np.empty(found)
        part = Line(self.line.number, value, np.frombuffer(value, dtype=np.uint8), 0, len(value), True)
        read_numbers(part, 0, numbers, f"of {{{key}}}")
        return numbers

    def number(self, key: str, default: float = np.nan) -> float:
        """A value as one finite number; `default` when it is not there."""
        if key not in self.fields:
            return default
        try:
            value = float(self.fields[key])
        except ValueError:
            value = float(self.numbers(key, 1)[0])
        most = _MOST.get(key, LIMITS.coordinate)
        if not abs(value) <= most:
            raise MalformedLineError(f"{value} in {{{key}}}", f"a finite number of at most {most:g}")
        return value


def parse_message(line: Line) -> Message | None:
    """Take a line apart; None for a blank line or a comment.

    Raises:
        MalformedLineError: the line breaks the format.
    """
    text = line.text.strip()
    if not text or text.startswith((b"#", b"//")):
        return None
    head, brace, rest = text.partition(b"{")
    kind = _KIND.fullmatch(head.strip())
    if kind is None or not brace:
        raise MalformedLineError(f"'{_shown(text)}'", "a message such as SEN {Type RangeScanner} …")
    fields: dict[str, bytes] = {}
    for body in rest.split(b"{"):
        inside, end, after = body.partition(b"}")
        if not end or after.strip():
            raise MalformedLineError(f"'{{{_shown(body)}'", "a value that ends with its own '}'")
        fields.update(_values(inside))
    return Message(line=line, kind=kind.group().decode().upper(), fields=fields)


def parse_sensors(line: Line) -> list[Message]:
    """The parts of a line that is about several sensors of one type, as CONF and GEO messages are.

    Raises:
        MalformedLineError: the line breaks the format.
    """
    whole = parse_message(line)
    if whole is None:
        return []
    pairs = [
        pair for body in line.text.partition(b"{")[2].split(b"{") for pair in _values(body.partition(b"}")[0]).items()
    ]
    if sum(key == "name" for key, _ in pairs) < 2:
        return [whole]
    shared: dict[str, bytes] = {}
    sensors: list[dict[str, bytes]] = []
    for key, value in pairs:
        if key == "name":
            sensors.append(dict(shared))
        (sensors[-1] if sensors else shared)[key] = value
    return [Message(line=line, kind=whole.kind, fields=fields) for fields in sensors]


def _values(inside: bytes) -> dict[str, bytes]:
    """The keys of one brace with their values; numbers parted by blanks belong together."""
    key, *rest = inside.split(None, 1)[:2] or [b""]
    value = rest[0].rstrip() if rest else b""
    if b" " not in value and b"\t" not in value:
        return {_key(key): value}
    values: dict[str, bytes] = {}
    key, *words = inside.split()
    parts: list[bytes] = []
    for word in words:
        if not parts or parts[-1].endswith(b",") or _CONTINUES.match(word):
            parts.append(word)
        else:
            values[_key(key)] = b" ".join(parts)
            key, parts = word, []
    values[_key(key)] = b" ".join(parts)
    return values


def _key(word: bytes) -> str:
    return word.decode("ascii", "backslashreplace").lower()


def _shown(text: bytes) -> str:
    return text[:40].decode("ascii", "backslashreplace")
