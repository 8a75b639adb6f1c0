"""Plain encoders and decoders of the RAW formats, word by word, to compare the fast ones with."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from motiondlo.events.joining import join
from motiondlo.events.stream_decoder import StreamDecoder
from motiondlo.events.types import EVENT_DTYPE, TRIGGER_DTYPE, EventArray, TriggerArray


def make_events(rows: Iterable[tuple[int, int, int, int]]) -> EventArray:
    """Events from (t_us, x, y, polarity)."""
    return np.array(list(rows), EVENT_DTYPE)


def make_triggers(rows: Iterable[tuple[int, int, int]]) -> TriggerArray:
    """Triggers from (t_us, channel, edge)."""
    return np.array(list(rows), TRIGGER_DTYPE)


def random_events(n: int, seed: int = 0, mean_step_us: float = 2.0, width: int = 1280, height: int = 720) -> EventArray:
    """n events at random places, in time order."""
    rng = np.random.default_rng(seed)
    events = np.zeros(n, EVENT_DTYPE)
    events["t"] = np.cumsum(rng.poisson(mean_step_us, n))
    events["x"] = rng.integers(0, width, n)
    events["y"] = rng.integers(0, height, n)
    events["p"] = rng.integers(0, 2, n)
    return events


def words16(words: Iterable[int]) -> bytes:
    """EVT3 words to bytes."""
    return np.array(list(words), "<u2").tobytes()


def plain_evt3(data: bytes) -> tuple[EventArray, TriggerArray]:
    """Decode sound EVT3 data, one word after the other, without any care for damage."""
    events, triggers = [], []
    laps, high, low, row, base, polarity = 0, -1, 0, 0, 0, 0
    for word in np.frombuffer(data[: len(data) // 2 * 2], "<u2").astype(int):
        kind, value = word >> 12, word & 0xFFF
        t_us = ((laps << 12 | max(high, 0)) << 12) | low
        if kind == 0x8:
            if high >= 0 and high - value >= 2048:
                laps += 1
            if value != high:
                low = 0
            high = value
        elif high < 0:
            continue
        elif kind == 0x6:
            low = value
        elif kind == 0x0:
            row = value & 0x7FF
        elif kind == 0x2:
            events.append((t_us, value & 0x7FF, row, value >> 11))
        elif kind == 0x3:
            base, polarity = value & 0x7FF, value >> 11
        elif kind in (0x4, 0x5):
            bits = 12 if kind == 0x4 else 8
            events.extend((t_us, base + i, row, polarity) for i in range(bits) if value >> i & 1)
            base += bits
        elif kind == 0xA:
            triggers.append((t_us, value >> 8, value & 1))
    return make_events(events), make_triggers(triggers)


def plain_evt2_words(events: EventArray, triggers: TriggerArray) -> bytes:
    """Encode as EVT2, with a time high every 64 us of data."""
    items = [(int(e["t"]), 1, int(e["p"]) << 28 | int(e["x"]) << 11 | int(e["y"])) for e in events]
    items += [(int(k["t"]), 0, 0xA << 28 | int(k["channel"]) << 8 | int(k["edge"])) for k in triggers]
    words, high = [], -1
    for t_us, _, word in sorted(items, key=lambda item: item[:2]):
        if t_us >> 6 != high:
            high = t_us >> 6
            words.append(0x8 << 28 | high & 0xFFFFFFF)
        words.append(word | (t_us & 0x3F) << 22)
    return np.array(words, "<u4").tobytes()


def plain_evt21_words(events: EventArray, swapped: bool = False) -> bytes:
    """Encode as EVT2.1, one event a vector, at bit ``x % 32`` of the aligned base."""
    words, high = [], -1
    for e in events:
        t_us, x = int(e["t"]), int(e["x"])
        if t_us >> 6 != high:
            high = t_us >> 6
            words.append((0x8 << 28 | high & 0xFFFFFFF, 0))
        head = int(e["p"]) << 28 | (t_us & 0x3F) << 22 | (x // 32 * 32) << 11 | int(e["y"])
        words.append((head, 1 << x % 32))
    pairs = np.array(words, "<u4")
    return (pairs if swapped else pairs[:, ::-1]).tobytes()


def decode(decoder: StreamDecoder, data: bytes, chunk: int = 1 << 16) -> tuple[EventArray, TriggerArray]:
    """Everything that the decoder gives for ``data`` in pieces of ``chunk`` bytes."""
    parts = [decoder.push(data[i : i + chunk]) for i in range(0, len(data), chunk)]
    parts.append(decoder.flush())
    return join([p[0] for p in parts]), join([p[1] for p in parts])
