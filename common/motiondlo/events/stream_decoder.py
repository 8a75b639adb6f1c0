"""Bytes in, events and triggers out: what the decoders of all RAW formats share.

State survives any chunk boundary. Buffers are bounded: input is decoded in slices, and at most PENDING_MAX events wait
for their time to be confirmed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from motiondlo.events.damage import (
    C_COUNT,
    C_EVENTS_DROPPED,
    C_REALIGNED,
    C_SKIPPED_BYTES,
    C_TRUNCATED_BYTES,
    clock_marks,
    damage_counts,
)
from motiondlo.events.joining import join
from motiondlo.events.resync_kernels import R_COUNT, R_LENGTH, RUN_WORDS_AT_END, find_run
from motiondlo.events.time_word_kernels import (
    MODE_START,
    PENDING_MAX,
    S_BASE_X,
    S_COUNT,
    S_DAMAGE_WORD,
    S_FLOOR_US,
    S_HEIGHT,
    S_HIGH,
    S_HIGH_MOD,
    S_K,
    S_K_DONE,
    S_LOW_BITS,
    S_MEAN_STEP_16,
    S_MODE,
    S_N,
    S_N_DONE,
    S_NEAR,
    S_PREVIOUS,
    S_ROW,
    S_SUSPECT,
    S_SUSPECT_LOST,
    S_T_US,
    S_WIDTH,
    S_WORD,
    SUSPECT_NONE,
    TRIGGERS_PENDING_MAX,
    confirm,
    disprove,
)
from motiondlo.events.types import (
    EVENT_DTYPE,
    TRIGGER_DTYPE,
    EventArray,
    SensorGeometry,
    TriggerArray,
    empty_events,
    empty_triggers,
)

Int64Array = npt.NDArray[np.int64]
ByteArray = npt.NDArray[np.uint8]
Kernel = Callable[[ByteArray, int, int, Int64Array, Int64Array, Int64Array, Int64Array], int]
Chunk = bytes | bytearray | memoryview

_SLICE_WORDS = 1 << 14
_NEAR_GAP_US = 1 << 16
"""Time words that skip ahead by less are ordinary silence."""


class StreamDecoder:
    """Streaming decoder of one RAW format; see the subclasses."""

    def __init__(
        self,
        geometry: SensorGeometry,
        kernel: Kernel,
        resume: Callable[[Int64Array, int], None],
        resync_format: int,
        word_bytes: int,
        events_per_word: int,
        low_bits: int,
        high_bits: int,
    ) -> None:
        self.geometry = geometry
        self._kernel = kernel
        self._resume = resume
        self._resync_format = resync_format
        self._word_bytes = word_bytes
        self._slice_bytes = _SLICE_WORDS * word_bytes
        self._counts = np.zeros(C_COUNT, np.int64)
        state = np.zeros(S_COUNT, np.int64)
        state[S_HIGH] = state[S_ROW] = state[S_BASE_X] = state[S_PREVIOUS] = -1
        state[S_DAMAGE_WORD] = -(1 << 60)
        state[S_MODE] = MODE_START
        state[S_LOW_BITS] = low_bits
        state[S_HIGH_MOD] = 1 << high_bits
        state[S_NEAR] = _NEAR_GAP_US >> low_bits
        state[S_WIDTH] = geometry.width_px
        state[S_HEIGHT] = geometry.height_px
        state[S_MEAN_STEP_16] = 16 << low_bits
        self._state = state
        # Room for a slice of nothing but full vectors on top; its pages are touched only if such a slice comes.
        self._take_above = PENDING_MAX
        self._out = np.empty((2 * PENDING_MAX + events_per_word * _SLICE_WORDS, 2), np.int64)
        self._triggers = np.empty((2 * TRIGGERS_PENDING_MAX + _SLICE_WORDS, 2), np.int64)
        self._tail = b""
        self._searching = False
        self._runs = np.zeros((word_bytes, R_COUNT), np.int64)
        self._scan = 0
        self._damage_start = 0

    @property
    def damage(self) -> dict[str, int]:
        """Counts so far per kind of damage; empty for a sound stream."""
        return damage_counts(self._counts)

    @property
    def marks(self) -> dict[str, int]:
        """``wraps`` of the camera's counter and ``gaps`` of its time words so far."""
        return clock_marks(self._counts)

    @property
    def time_us(self) -> int:
        """Everything before this time has been given out, -1 before the first time word. Never decreases."""
        return int(self._state[S_FLOOR_US]) if self._state[S_HIGH] >= 0 else -1

    def push(self, chunk: Chunk) -> tuple[EventArray, TriggerArray]:
        """Decode a chunk of any size, also one that ends within a word.

        Returns the events (N,) and triggers (K,) whose time is confirmed, in time order; the rest follows with the next
        time word. The arrays belong to the caller.
        """
        return self._gather(self._decode(chunk))

    def flush(self) -> tuple[EventArray, TriggerArray]:
        """End of the stream: give out what was held back, count an incomplete word."""
        parts = []
        if self._searching:
            self._stop_searching_at_end()
            parts = self._decode(b"")
        state = self._state
        if state[S_SUSPECT] != SUSPECT_NONE and state[S_SUSPECT_LOST]:
            # nothing speaks for this time but a word right behind damage
            disprove(state, self._counts)
            self._counts[C_EVENTS_DROPPED] += state[S_N] - state[S_N_DONE] + state[S_K] - state[S_K_DONE]
            state[S_N], state[S_K], state[S_T_US] = state[S_N_DONE], state[S_K_DONE], state[S_FLOOR_US]
        confirm(state, self._counts)
        state[S_N_DONE], state[S_K_DONE] = state[S_N], state[S_K]
        if state[S_HIGH] >= 0:
            state[S_FLOOR_US] = max(state[S_FLOOR_US], state[S_T_US])
        self._counts[C_TRUNCATED_BYTES] += len(self._tail)
        self._tail = b""
        parts.append(self._take())
        return self._gather(parts)

    def _decode(self, chunk: Chunk) -> list[tuple[EventArray, TriggerArray]]:
        data = np.frombuffer(self._tail + bytes(chunk) if self._tail else chunk, np.uint8)
        parts = []
        at = 0
        while True:
            if self._searching:
                at = self._search(data, at)
                if self._searching:
                    break
            end = min(len(data), at + self._slice_bytes)
            stop = at + (end - at) // self._word_bytes * self._word_bytes
            if stop == at:
                break
            reached = self._kernel(data, at, stop, self._state, self._counts, self._out, self._triggers)
            at = reached
            if self._state[S_N] > self._take_above or self._state[S_K] > TRIGGERS_PENDING_MAX:
                parts.append(self._take())
            if reached < stop:
                self._start_searching(at)
        if self._state[S_N_DONE] or self._state[S_K_DONE]:
            parts.append(self._take())
        self._tail = data[at:].tobytes()
        self._damage_start -= at
        self._scan -= at
        return parts

    def _take(self) -> tuple[EventArray, TriggerArray]:
        """Copy what is confirmed, move what waits to the front."""
        state = self._state
        n, n_done, k, k_done = (int(state[i]) for i in (S_N, S_N_DONE, S_K, S_K_DONE))
        events = self._out[:n_done].copy().view(EVENT_DTYPE)[:, 0] if n_done else empty_events()
        triggers = self._triggers[:k_done].copy().view(TRIGGER_DTYPE)[:, 0] if k_done else empty_triggers()
        if n > n_done:
            self._out[: n - n_done] = self._out[n_done:n].copy()
        if k > k_done:
            self._triggers[: k - k_done] = self._triggers[k_done:k].copy()
        state[S_N], state[S_N_DONE], state[S_K], state[S_K_DONE] = n - n_done, 0, k - k_done, 0
        return events, triggers

    @staticmethod
    def _gather(parts: list[tuple[EventArray, TriggerArray]]) -> tuple[EventArray, TriggerArray]:
        if not parts:
            return empty_events(), empty_triggers()
        if len(parts) == 1:
            return parts[0]
        return join([p[0] for p in parts]), join([p[1] for p in parts])

    def _start_searching(self, at: int) -> None:
        self._searching = True
        self._damage_start = at
        self._scan = at + self._word_bytes
        self._runs[:, R_LENGTH] = 0

    def _search(self, data: ByteArray, at: int) -> int:
        """Look for undamaged data; returns where decoding resumes, or from where on bytes must be kept."""
        run_start: int
        run_start, self._scan = find_run(data, self._scan, len(data), self._resync_format, self._word_bytes, self._runs)
        if run_start < 0:
            starts = [self._scan + a - int(n) * self._word_bytes for a, n in enumerate(self._runs[:, R_LENGTH])]
            return min(max(min(starts), at), len(data))
        self._resume_at(run_start)
        return run_start

    def _stop_searching_at_end(self) -> None:
        """The stream ends: a run that was too short to be sure is accepted if it is long enough here."""
        lengths = self._runs[:, R_LENGTH]
        best = int(np.argmax(lengths))
        if lengths[best] >= RUN_WORDS_AT_END:
            run_start = self._scan + best - int(lengths[best]) * self._word_bytes
            self._resume_at(run_start)
            self._tail = self._tail[run_start:]
            self._damage_start -= run_start
        else:
            self._searching = False
            self._counts[C_SKIPPED_BYTES] += len(self._tail) - self._damage_start
            self._tail = b""

    def _resume_at(self, run_start: int) -> None:
        self._searching = False
        skipped = run_start - self._damage_start
        self._counts[C_SKIPPED_BYTES] += skipped
        self._counts[C_REALIGNED] += skipped % self._word_bytes != 0
        self._state[S_DAMAGE_WORD] = self._state[S_WORD]
        self._resume(self._state, skipped)
