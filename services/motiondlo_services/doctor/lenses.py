"""The lens files of a cell: readable, of the right size, plausible."""

from __future__ import annotations

from collections.abc import Callable

from motiondlo.config.cell import Cell
from motiondlo.errors import MotionDLOError
from motiondlo.geometry.lens import LensModel
from motiondlo_services.doctor.findings import Finding, failure, ok, warning

_STRANGE_SHARE = 0.2


def check_lenses(cell: Cell) -> list[Finding]:
    """One finding per lens file that the cell names."""
    sensor = (cell.geometry.width_px, cell.geometry.height_px)
    return [*_lens("rgb lens", cell.rgb_lens, None), *_lens("event lens", cell.event_lens, sensor)]


def _lens(subject: str, read: Callable[[], LensModel | None], size: tuple[int, int] | None) -> list[Finding]:
    try:
        lens = read()
    except MotionDLOError as error:
        return [failure(subject, error.what, error.what_to_do)]
    if lens is None:
        return []
    if size is not None and lens.size_px != size:
        what = f"calibrated for {lens.size_px[0]}x{lens.size_px[1]} px, the sensor has {size[0]}x{size[1]}"
        return [failure(subject, what, "Calibrate the lens at the sensor's own size.")]
    shift = lens.largest_shift_px()
    if shift > _STRANGE_SHARE * lens.size_px[0]:
        return [warning(subject, f"moves points by up to {shift:.0f} px", "Check the file: that is a strange lens.")]
    return [ok(subject, f"moves points by up to {shift:.1f} px")]
