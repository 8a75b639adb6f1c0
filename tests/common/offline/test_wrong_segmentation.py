"""The fault injector: what is wrong with its shapes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from motiondlo.cli.track import WRONG_SHAPES
from motiondlo.frames.types import EndKind, Instance, Segmentation
from motiondlo.geometry.curve import arc_length
from motiondlo.offline.wrong_segmentation import WrongShape, wrong_segmentation

FloatArray = npt.NDArray[np.float64]


def bow(y: float) -> FloatArray:
    x = np.linspace(100.0, 500.0, 30)
    return np.stack([x, y + 60.0 * np.sin((x - 100.0) / 400.0 * np.pi)], axis=1)


def seen(*curves: FloatArray) -> Segmentation:
    return Segmentation(
        1000,
        "frame",
        tuple(Instance(c, c, np.full(len(c), 1.0), 20.0, 20.0, 0.9, (EndKind.HELD, EndKind.TIP)) for c in curves),
    )


def wrong(kind: WrongShape, *curves: FloatArray) -> tuple[Instance, ...]:
    return wrong_segmentation(seen(*curves), kind, 50.0).instances


def nodes(instance: Instance) -> FloatArray:
    assert instance.nodes_event is not None
    return instance.nodes_event


def test_the_command_line_offers_all_of_them() -> None:
    assert tuple(kind.value for kind in WrongShape) == WRONG_SHAPES


def test_mirrored_bends_to_the_other_side_between_the_same_ends() -> None:
    (instance,) = wrong(WrongShape.MIRRORED, bow(200.0))
    np.testing.assert_allclose(nodes(instance)[:, 1] - 200.0, 200.0 - bow(200.0)[:, 1], atol=1e-9)


def test_shifted_lies_beside() -> None:
    (instance,) = wrong(WrongShape.SHIFTED, bow(200.0))
    np.testing.assert_allclose(np.hypot(*(nodes(instance) - bow(200.0)).T), 50.0)


def test_merged_is_one_line_through_both() -> None:
    first, _ = wrong(WrongShape.MERGED, bow(200.0), bow(400.0))
    assert arc_length(nodes(first))[-1] > 2.0 * arc_length(bow(200.0))[-1]
    np.testing.assert_allclose(nodes(first)[0], bow(200.0)[0])
    assert len(first.sigma_px) == len(nodes(first))


def test_swapped_has_the_others_shape_at_its_own_place() -> None:
    straight = np.stack([np.linspace(100.0, 300.0, 30), np.full(30, 600.0)], axis=1)
    first, second = wrong(WrongShape.SWAPPED, bow(200.0), straight)
    np.testing.assert_allclose(nodes(first).mean(axis=0), bow(200.0).mean(axis=0))
    assert np.ptp(nodes(first)[:, 1]) < 1e-9
    assert np.ptp(nodes(second)[:, 1]) == pytest.approx(np.ptp(bow(0.0)[:, 1]))


def test_shortened_ends_in_a_tip_too_early() -> None:
    (instance,) = wrong(WrongShape.SHORTENED, bow(200.0))
    assert arc_length(nodes(instance))[-1] == pytest.approx(0.6 * arc_length(bow(200.0))[-1], rel=0.01)
    assert instance.ends == (EndKind.HELD, EndKind.TIP)


def test_extra_keeps_what_is_right_and_adds_one_elsewhere_each_time() -> None:
    instances = wrong(WrongShape.EXTRA, bow(200.0))
    assert len(instances) == 2
    np.testing.assert_array_equal(nodes(instances[0]), bow(200.0))
