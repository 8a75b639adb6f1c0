"""What cables are made of: how they look and how they bend."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np

from motiondlo.simulation.scene import CableKind

Rgb = tuple[float, float, float]

_LEAST_CONTRAST = 0.45


@dataclass(frozen=True)
class Material:
    """Looks of a cable. Reflectances are linear."""

    rgb: tuple[float, float, float]
    spec: float
    """Strength of the highlight."""
    shine: float
    """Exponent of the highlight."""
    ambient: float
    noise: float
    """Grain, relative."""
    noise_mm: float
    print_amp: float
    """Relative change of the reflectance by the printing; 0: none."""
    print_period_mm: float
    print_len_mm: float
    seed: int
    clear: float
    """Share of the board that shines through."""


@dataclass(frozen=True)
class Mechanics:
    """How a cable of a kind bends and slides."""

    diameter_mm: float
    length_mm: tuple[float, float]
    kg_per_m: float
    bending_n_m2: float
    friction: float


MECHANICS: dict[CableKind, Mechanics] = {
    "tube": Mechanics(6.0, (140.0, 195.0), 0.0287, 6.5e-3, 0.45),
    "printed": Mechanics(6.5, (130.0, 190.0), 0.068, 1.6e-2, 0.45),
    "cord": Mechanics(4.0, (120.0, 180.0), 0.021, 3.5e-3, 0.5),
    "wire": Mechanics(1.0, (110.0, 170.0), 0.0031, 8.0e-4, 0.45),
}


def scaled_mechanics(kind: CableKind, diameter_mm: float) -> tuple[float, float]:
    """Mass per metre (kg/m) and bending stiffness (N m^2) of a kind at a diameter that is not its usual one.

    Mass goes with the cross-section. Stiffness with the cube rather than the fourth power: thin cables of a kind have
    thinner walls and finer strands.
    """
    usual = MECHANICS[kind]
    ratio = diameter_mm / usual.diameter_mm
    return usual.kg_per_m * ratio**2, usual.bending_n_m2 * ratio**3


def draw_material(kind: CableKind, rgb: Rgb | None, board: Rgb, rng: np.random.Generator) -> Material:
    """A material of this kind; without ``rgb`` a colour that stands out from the board's."""
    colour = _visible_colour(board, rng) if rgb is None else rgb
    dark = sum(colour) / 3.0 < 0.15
    printed = kind == "printed"
    glossy = kind in ("tube", "wire")
    return Material(
        rgb=colour,
        spec=0.45 if kind == "tube" else 0.25 if kind == "wire" else 0.04,
        shine=45.0 if kind == "tube" else 25.0 if kind == "wire" else 8.0,
        ambient=0.35,
        noise=0.05 if glossy else 0.06 if printed else 0.08,
        noise_mm=0.7,
        print_amp=0.0 if not printed else (1.2 if dark or rng.random() < 0.4 else -0.6),
        print_period_mm=70.0,
        print_len_mm=38.0 if printed else 0.0,
        seed=int(rng.integers(1, 1000)),
        clear=float(rng.uniform(0.03, 0.12)) if kind == "tube" else 0.0,
    )


def _visible_colour(board: Rgb, rng: np.random.Generator) -> Rgb:
    """The event camera sees brightness alone: the cable is brighter or darker than the board by half at least."""
    seen = np.array([0.299, 0.587, 0.114])
    while True:
        colour = _draw_colour(rng)
        ratio = float(seen @ np.asarray(colour)) / float(seen @ np.asarray(board))
        if abs(np.log(ratio)) > _LEAST_CONTRAST:
            return colour


def _draw_colour(rng: np.random.Generator) -> Rgb:
    """Any colour, and black, grey or white as often as cables are."""
    kind = rng.random()
    if kind < 0.2:
        grey = float(rng.uniform(0.025, 0.04))
        return grey, grey, grey
    if kind < 0.35:
        grey = float(rng.uniform(0.45, 0.65))
        return grey, grey, grey
    red, green, blue = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.6, 0.95), rng.uniform(0.28, 0.72))
    return float(red), float(green), float(blue)
