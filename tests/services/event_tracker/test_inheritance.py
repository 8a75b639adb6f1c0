"""Corrections from before a tracker's start: wanted at a cell's start, superseded after a restart."""

from __future__ import annotations

import numpy as np

from motiondlo.messages.correction import CorrectionMessage
from motiondlo_services.event_tracker.inheritance import HOLD_NS, Inheritance

START_NS = 1_000_000_000


def correction(seq: int, t_sent_ns: int) -> CorrectionMessage:
    nodes = np.array([[0.0, 0.0], [100.0, 0.0]])
    message = CorrectionMessage(
        t_us=0, correction_seq=seq, id=0, kind="reinitialise", nodes=nodes, sigma_normal_px=np.ones(2),
        sigma_tangent_px=np.ones(2),
    )  # fmt: skip
    return message.model_copy(update={"t_sent_ns": t_sent_ns})


def test_a_new_cells_first_shapes_are_taken_after_a_moment() -> None:
    inheritance = Inheritance(START_NS)
    first = correction(1, START_NS - 1)
    assert inheritance.sort(first, START_NS + 10) == ([], [])
    assert inheritance.due(START_NS + HOLD_NS) == []
    assert inheritance.due(START_NS + 10 + HOLD_NS) == [first]
    assert inheritance.due(START_NS + 10 + 2 * HOLD_NS) == []


def test_RESTARTED_tracker_takes_what_fusion_sends_now_and_refuses_what_it_once_sent() -> None:
    inheritance = Inheritance(START_NS)
    old, older = correction(2, START_NS - 1), correction(1, START_NS - 5)
    new = correction(3, START_NS + 5)
    assert inheritance.sort(older, START_NS + 1) == ([], [])
    assert inheritance.sort(new, START_NS + 6) == ([new], [older])
    assert inheritance.sort(old, START_NS + 7) == ([], [old])
    assert inheritance.due(START_NS + 10 * HOLD_NS) == []
