"""Whole laser messages out of a block of text, compiled: those that are as plain as nearly all are."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.logs._number_kernels import _is_space, scan_numbers
from graph.compiled import compiled, compiled_aside

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class Plain(NamedTuple):
    """What a message must be like to be read here.

    Attributes:
        described: it begins with the laser's description and has remissions.
        n_poses: numbers between the readings and the stamps; the first six of them are kept.
        description: (4,) of the laser, which must be the same.
        most: greatest coordinate [m] …
        most_heading: … heading [rad] …
        most_stamp: … and stamp [s].
        most_type: greatest type of a laser, which begins a description.
    """

    described: bool
    n_poses: int
    description: F64
    most: float
    most_heading: float
    most_stamp: float
    most_type: float


class Rows(NamedTuple):
    """Room for messages: (m, n_beams) readings, (m, 6) poses, (m, 2) stamps."""

    readings: F32
    poses: F64
    stamps: F64


@compiled_aside
def scan_sweeps(text: U8, start: int, names: U8, lengths: I64, plain: Plain, rows: Rows, counts: I64) -> int:
    """Read line after line until one is not plain, or there is no more room.

    Args:
        text: lines, the last one with its newline.
        start: where one of them begins.
        names: (k, w) first words; the first is that of the messages to read, the others are only counted …
        lengths: … (k,) of so many bytes.
        plain: what the messages must be like.
        rows: filled from the first row on.
        counts: (k + 1,) increased by the messages met, and at last by the comments and empty lines.

    Returns:
        Where the first line begins that was not read.
    """
    numbers = np.empty(max(rows.readings.shape[1], 16))
    position = start
    while position < len(text):
        stop = position
        while text[stop] != 10:
            stop += 1
        kind = _kind(text, position, stop, names, lengths)
        if kind < 0:
            break
        if kind == 0:
            row = counts[0]
            if row == len(rows.readings) or not _read(text, position + lengths[0], stop, plain, rows, row, numbers):
                break
        counts[kind] += 1
        position = stop + 1
    return position


@compiled
def _kind(text: U8, start: int, stop: int, names: U8, lengths: I64) -> int:
    """Which of the names a line begins with, a blank behind it; one more for a comment or nothing; -1 for all else."""
    first = start
    while first < stop and _is_space(text[first]):
        first += 1
    if first == stop or text[first] == 35:
        return len(names)
    for kind in range(len(names)):
        n = lengths[kind]
        if start + n < stop and text[start + n] == 32:
            k = 0
            while k < n and text[start + k] == names[kind, k]:
                k += 1
            if k == n:
                return kind
    return -1


@compiled
def _read(text: U8, start: int, stop: int, plain: Plain, rows: Rows, row: int, numbers: F64) -> bool:
    """Fill one row; False where the message is not plain."""
    n_beams, position = rows.readings.shape[1], start
    if plain.described:
        done, position = scan_numbers(text, position, stop, numbers[:7])
        if done < 7 or not 0.0 <= numbers[0] <= plain.most_type:
            return False
        for k in range(4):
            if numbers[1 + k] != plain.description[k]:
                return False
    done, position = scan_numbers(text, position, stop, numbers[:1])
    if done < 1 or numbers[0] != n_beams:
        return False
    done, position = scan_numbers(text, position, stop, numbers[:n_beams])
    if done < n_beams:
        return False
    for k in range(n_beams):
        rows.readings[row, k] = np.float32(numbers[k])
    if plain.described:
        done, position = scan_numbers(text, position, stop, numbers[:1])
        n = int(numbers[0])
        if done < 1 or not 0 <= n <= len(numbers) or n != numbers[0]:
            return False
        done, position = scan_numbers(text, position, stop, numbers[:n])
        if done < n:
            return False
    done, position = scan_numbers(text, position, stop, numbers[: plain.n_poses])
    if done < plain.n_poses or not _keep_poses(numbers, plain, rows.poses, row):
        return False
    return _read_stamps(text, position, stop, plain.most_stamp, rows.stamps, row, numbers)


@compiled
def _keep_poses(numbers: F64, plain: Plain, poses: F64, row: int) -> bool:
    for k in range(min(plain.n_poses, 6)):
        if not abs(numbers[k]) <= (plain.most_heading if k % 3 == 2 else plain.most):
            return False
        poses[row, k] = numbers[k]
    return True


@compiled
def _read_stamps(text: U8, start: int, stop: int, most: float, stamps: F64, row: int, numbers: F64) -> bool:
    """Read a number, a word and a number that end the line."""
    done, position = scan_numbers(text, start, stop, numbers[:1])
    while position < stop and _is_space(text[position]):
        position += 1
    word = position
    while position < stop and not _is_space(text[position]):
        position += 1
    more, end = scan_numbers(text, position, stop, numbers[1:2])
    if done < 1 or word == position or more < 1:
        return False
    while end < stop and _is_space(text[end]):
        end += 1
    for k in range(2):
        if not abs(numbers[k]) <= most:
            return False
        stamps[row, k] = numbers[k]
    return end == stop
