"""Damage as it happens, and as somebody would do it on purpose: deterministic, from a seeded generator."""

from __future__ import annotations

import random
from collections.abc import Callable

NASTY_BYTES = (0x00, 0x7F, 0x80, 0xFF, 0xC1, 0xC6, 0xDD, 0xDF, 0x5B, 0x7B, 0x22, 0x25)
NASTY_NUMBERS = (
    b"\xff" * 8,
    b"\x00" * 8,
    b"\x7f" + b"\xff" * 7,
    b"\x80" + b"\x00" * 7,
    b"NaN",
    b"1e999",
    b"-1",
    b"9" * 30,
)
MAX_BYTES = 4096
"""Damaged inputs grow no larger than this."""


def _flip(data: bytearray, rng: random.Random) -> None:
    if data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _overwrite(data: bytearray, rng: random.Random) -> None:
    if data:
        data[rng.randrange(len(data))] = rng.choice(NASTY_BYTES)


def _cut(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data) + 1) :]


def _remove(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    del data[at : at + rng.randrange(1, 17)]


def _insert(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    data[at:at] = rng.randbytes(rng.randrange(1, 33))


def _number(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    number = rng.choice(NASTY_NUMBERS)
    data[at : at + len(number) * rng.randrange(2)] = number


def _repeat(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    data[at:at] = data[at : at + rng.randrange(1, 65)] * rng.randrange(1, 9)


def _swap(data: bytearray, rng: random.Random) -> None:
    a, b = sorted((rng.randrange(len(data) + 1), rng.randrange(len(data) + 1)))
    length = min(rng.randrange(1, 33), b - a)
    data[a : a + length], data[b : b + length] = data[b : b + length], data[a : a + length]


STEPS: tuple[Callable[[bytearray, random.Random], None], ...] = (
    _flip,
    _overwrite,
    _cut,
    _remove,
    _insert,
    _number,
    _repeat,
    _swap,
)


def damaged(seeds: list[bytes], rng: random.Random) -> bytes:
    """One of the sound inputs after 1 to 6 kinds of damage; now and then noise alone, or two inputs run together."""
    kind = rng.randrange(20)
    if kind == 0:
        return rng.randbytes(rng.randrange(300))
    data = bytearray(rng.choice(seeds))
    if kind == 1:
        other = rng.choice(seeds)
        data[rng.randrange(len(data) + 1) :] = other[rng.randrange(len(other) + 1) :]
    for _ in range(rng.randrange(1, 7)):
        rng.choice(STEPS)(data, rng)
        del data[MAX_BYTES:]
    return bytes(data)
