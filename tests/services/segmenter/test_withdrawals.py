"""Cancelled requests: told before or after their frame has come."""

from __future__ import annotations

from typing import Any

from motiondlo.messages.command import CommandRequest
from motiondlo_services.segmenter.withdrawals import MOST_REMEMBERED, Withdrawals


class FakeCommand:
    """Notes its answer."""

    def __init__(self, target: str = "", **args: Any) -> None:
        self.request = CommandRequest(verb="segment", target=target, args=args)
        self.answered: Any = None

    def answer(self, result: Any = None) -> None:
        self.answered = result or {}

    def refuse(self, error: str, what_to_do: str = "") -> None:
        self.answered = what_to_do


class FakeCommands:
    """Gives them one by one."""

    def __init__(self, *commands: FakeCommand) -> None:
        self.commands = list(commands)

    def take(self) -> Any:
        return self.commands.pop(0) if self.commands else None


def test_a_cancelled_request_is_known_by_its_id() -> None:
    cancel = FakeCommand(cancel="fusion-3")
    withdrawals = Withdrawals(FakeCommands(cancel))
    withdrawals.look()
    assert cancel.answered == {}
    assert withdrawals.has("fusion-3")
    assert not withdrawals.has("fusion-4")
    assert not withdrawals.has(""), "a frame that nobody asked for"


def test_requests_for_frames_are_not_the_segmenters() -> None:
    asked, everybody = FakeCommand(target="segmenter", after_us=1), FakeCommand(after_us=1)
    Withdrawals(FakeCommands(asked, everybody)).look()
    assert "frame-capture" in asked.answered
    assert everybody.answered == {"accepted": False}


def test_only_the_last_ones_are_remembered() -> None:
    withdrawals = Withdrawals(FakeCommands(*(FakeCommand(cancel=f"r{k}") for k in range(100))))
    withdrawals.look()
    assert [withdrawals.has(f"r{k}") for k in (99 - MOST_REMEMBERED, 100 - MOST_REMEMBERED, 99)] == [False, True, True]
