"""Confidence falls where tracking is about to fail, and holds at rest."""

from __future__ import annotations

from motiondlo.tracking.inextensible.confidence import Confidence, UnexplainedEvents


def followed(seen: int, could: int = 20, steps: int = 200) -> Confidence:
    confidence = Confidence()
    for _ in range(steps):
        confidence.advance(1.0, seen, could)
    return confidence


def test_a_dlo_that_is_hardly_seen_is_trusted_less() -> None:
    well = followed(18).value(False, 18, 0.4, 0.1)
    badly = followed(2).value(False, 2, 0.4, 0.1)
    assert well > 0.9
    assert badly < well - 0.08


def test_an_unsure_curve_is_trusted_less() -> None:
    assert followed(10).value(False, 10, 6.0, 0.1) < followed(10).value(False, 10, 0.3, 0.1)


def test_rest_is_believed_unless_something_moves_that_is_no_dlo() -> None:
    rests = followed(18)
    assert rests.value(True, 0, 0.4, 0.02) > 0.9
    assert rests.value(True, 0, 0.4, 1.0) < 0.5


def test_background_alone_is_not_unexplained_motion() -> None:
    background, missed, explained = UnexplainedEvents(), UnexplainedEvents(), UnexplainedEvents()
    for _ in range(50):
        background.advance(2.0, 20, 0)
        missed.advance(2.0, 8000, 200)
        explained.advance(2.0, 8000, 7500)
    assert background.share < 0.1
    assert missed.share > 0.9
    assert explained.share < 0.1
