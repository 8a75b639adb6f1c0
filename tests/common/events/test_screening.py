"""Screening: regions, flashes, flicker, hot pixels and the background, on made-up batches."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.events.buckets import EventBuckets
from motiondlo.events.screening import EventScreening
from motiondlo.events.screening_params import ScreeningParams
from motiondlo.events.screening_regions import region_mask, wrong_region
from motiondlo.events.types import EVENT_DTYPE, EventBatch, SensorGeometry

SENSOR = SensorGeometry(256, 128)
BATCH_US = 2000


def batch_of(k: int, x: np.ndarray, y: np.ndarray, p: np.ndarray | int = 1, t: np.ndarray | None = None) -> EventBatch:
    events = np.zeros(len(x), EVENT_DTYPE)
    events["t"] = k * BATCH_US + (np.linspace(0, BATCH_US - 1, len(x)) if t is None else t)
    events["x"], events["y"], events["p"] = x, y, p
    return EventBatch(k * BATCH_US, (k + 1) * BATCH_US, events)


def noise(k: int, n: int, rng: np.random.Generator) -> EventBatch:
    return batch_of(k, rng.integers(0, 256, n), rng.integers(0, 128, n), rng.integers(0, 2, n))


class Bench:
    """A screening that is fed batches, with no DLO anywhere."""

    def __init__(self, **params: bool | float) -> None:
        self.buckets = EventBuckets(SENSOR)
        self.screening = EventScreening(ScreeningParams(**params), self.buckets)
        self.tiles = np.zeros(self.screening.counts.shape, np.uint32)

    def feed(self, batch: EventBatch) -> int:
        """File a batch; how many of its events are in the buckets."""
        before = int(self.buckets.heads.sum())
        self.screening.look(batch, self.tiles, 0)
        self.screening.file(batch.events)
        return int(self.buckets.heads.sum()) - before


def test_without_disturbance_everything_is_filed_and_nothing_expected() -> None:
    bench, rng = Bench(hot_pixels=True), np.random.default_rng(0)
    assert sum(bench.feed(noise(k, 40, rng)) for k in range(100)) == 4000
    assert not bench.buckets.background.any()


def test_events_in_a_region_are_left_out_until_it_is_taken_away() -> None:
    bench = Bench()
    bench.screening.set_regions({"belt": (10.0, 20.0, 100.0, 60.0)})
    x, y = np.array([9, 10, 50, 100, 101]), np.array([40, 40, 40, 40, 40])
    assert bench.feed(batch_of(0, x, y)) == 2
    assert bench.screening.report()["masked_events"] == 3
    assert bench.buckets.region[40, 50]
    assert not bench.buckets.region[40, 101]
    bench.screening.set_regions({})
    assert bench.feed(batch_of(1, x, y)) == 5
    assert len(bench.buckets.region) == 0


def test_polygons_cover_what_lies_within() -> None:
    mask = region_mask({"corner": (0.0, 0.0, 60.0, 0.0, 0.0, 60.0)}, SENSOR)
    assert mask[10, 10]
    assert not mask[50, 50]
    assert int(mask.sum()) == 61 * 62 // 2


@pytest.mark.parametrize(
    ("corners", "names"),
    [((1.0, 2.0), "four"), ((0.0,) * 7, "even"), ((5.0, 0.0, 5.0, 9.0), "x0 < x1"), ((0.0, 0.0, np.nan, 1.0), "px")],
)
def test_a_wrong_region_is_refused(corners: tuple[float, ...], names: str) -> None:
    assert names in wrong_region(corners)
    with pytest.raises(ValueError, match="'belt'"):
        region_mask({"belt": corners}, SENSOR)


def test_a_flash_is_kept_away_and_counted_but_lasting_noise_becomes_background() -> None:
    bench, rng = Bench(), np.random.default_rng(1)
    bench.feed(noise(0, 100, rng))
    assert bench.feed(noise(1, 60_000, rng)) == 0
    assert bench.screening.flash
    assert bench.feed(noise(2, 100, rng)) == 100
    assert not bench.screening.flash
    filed = [bench.feed(noise(k, 60_000, rng)) for k in range(3, 9)]
    assert filed[:2] == [0, 0]
    assert filed[4:] == [60_000, 60_000]
    assert bench.screening.report()["flashes"] == 2
    assert bench.buckets.background.min() > 0.3


def test_background_is_measured_beside_the_dlos_and_falls_at_once() -> None:
    bench, rng = Bench(), np.random.default_rng(2)
    bench.tiles[:, :4] = 1
    for k in range(8):
        batch = noise(k, 4096, rng)
        bench.feed(batch)
    # 4096 events of 256x128 px in 2 ms are 0.0625 events/px/ms; the median of whole numbers is a little less
    assert bench.buckets.background[0] == pytest.approx(0.0625, rel=0.06)
    bench.feed(noise(8, 20, rng))
    assert not bench.buckets.background.any()


def test_what_fires_all_the_time_is_expected_there() -> None:
    bench, rng = Bench(), np.random.default_rng(3)
    for k in range(400):
        n = 30
        bench.feed(batch_of(k, rng.integers(64, 96, n), rng.integers(32, 48, n)))
    expected = bench.buckets.background.reshape(bench.tiles.shape)
    assert bench.screening.report()["learned_tiles"] == 2
    assert (expected[2, 4:6] > 0.01).all()
    assert expected[0].max() == 0.0


def test_a_moving_dlo_is_not_learned_as_a_region() -> None:
    bench, rng = Bench(), np.random.default_rng(4)
    bench.tiles[2, 4:6] = 1
    for k in range(400):
        batch = batch_of(k, rng.integers(64, 96, 30), rng.integers(32, 48, 30))
        bench.screening.look(batch, bench.tiles, 1)
    assert bench.screening.report()["learned_tiles"] == 0


@pytest.mark.parametrize("hz", [100.0, 120.0])
def test_flicker_is_found_and_left_out_where_it_is(hz: float) -> None:
    bench, rng = Bench(), np.random.default_rng(5)
    period_us = 1e6 / hz
    pixels = rng.permutation(64 * 64)[:2000]
    filed, made = 0, 0
    for k in range(150):
        # ON at the start of a period, OFF half a period later, at every lit pixel
        parts = []
        for p in range(2):
            first = int(np.floor(k * BATCH_US / period_us)) - 1
            for n in range(first, first + 3):
                at = n * period_us + p * 0.5 * period_us + (pixels % 97) * 3.0
                inside = (at >= k * BATCH_US) & (at < (k + 1) * BATCH_US)
                parts.append((at[inside] - k * BATCH_US, pixels[inside], np.full(inside.sum(), p)))
        t, pixel, p_of = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(t, kind="stable")
        batch = batch_of(k, pixel[order] % 64, pixel[order] // 64, p_of[order], t[order])
        added = bench.feed(batch)
        if k >= 110:
            filed, made = filed + added, made + len(batch.events)
    report = bench.screening.report()
    assert report["flicker_hz"] == pytest.approx(hz, abs=3.0)
    assert report["flicker_tiles"] == 16
    assert made > 10_000
    assert filed < 0.05 * made
    # an event at another time than the lamp's passes
    assert bench.feed(batch_of(150, np.array([10]), np.array([10]), 1, np.array([1900]))) <= 1


def test_a_hot_pixel_is_masked_and_a_busy_neighbourhood_is_not() -> None:
    bench, rng = Bench(hot_pixels=True, learned_regions=False), np.random.default_rng(6)
    for k in range(450):
        x = np.concatenate([np.full(2, 37), rng.integers(160, 176, 12)])
        y = np.concatenate([np.full(2, 21), rng.integers(64, 80, 12)])
        bench.feed(batch_of(k, x, y))
    assert bench.screening.report()["hot_pixels"] == 1
    assert bench.screening.masked[21, 37]
    assert bench.feed(batch_of(450, np.array([37, 38]), np.array([21, 21]))) == 1


def test_time_that_goes_back_leaves_the_regions() -> None:
    bench, rng = Bench(), np.random.default_rng(7)
    bench.screening.set_regions({"belt": (0.0, 0.0, 255.0, 127.0)})
    bench.feed(noise(100, 50, rng))
    bench.screening.clear()
    assert bench.feed(noise(0, 50, rng)) == 0
