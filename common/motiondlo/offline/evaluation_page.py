"""An evaluation as one self-contained HTML page: figures, errors over time, the worst moments."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from pathlib import Path

from motiondlo.drawing.overlay import png_bytes
from motiondlo.offline.error_plot import error_plot
from motiondlo.offline.evaluation import Evaluation, Verdict
from motiondlo.offline.ground_truth import GroundTruth
from motiondlo.offline.moment import picture_at, worst_moment
from motiondlo.offline.tracks import Tracks

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 1120px; padding: 0 1rem; color: #1b1b1b; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .6rem; text-align: right; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
tr.static td { color: #767676; }
img { max-width: 100%; height: auto; }
p.note { color: #555; }
"""

_HEADINGS = (
    "DLO", "id", "ptc mean", "median", "95 %", "paired", "cov", "lost", "switches", "lag ms", "rate Hz", "NEES",
    "NEES along", "ptc below 500 mm/s", "500 to 1000", "above 1000",
)  # fmt: skip


def evaluation_page(recording: Path, tracks: Tracks, truth: GroundTruth, evaluation: Evaluation) -> str:
    """The page; pictures are embedded. The recording's events are read for the pictures, if they are there."""
    name = escape(recording.resolve().name)
    parts = [
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{name}</title>',
        f"<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{name}</h1>",
        "<table>\n<tr>" + "".join(f"<th>{heading}</th>" for heading in _HEADINGS) + "</tr>",
        *(_row(verdict) for verdict in evaluation.moved + evaluation.static),
        "</table>",
        '<p class="note">Errors in mm. ptc: estimated nodes to the true centreline; paired: points at equal arc length '
        "on estimate and truth; cov: visible true nodes to the estimate. Grey rows never move; they are judged while "
        "anything else does. Plots are grey where a DLO is not judged.</p>",
    ]
    parts += _honesty(evaluation)
    if evaluation.unmatched_ids:
        parts.append(f"<p>Ids that match no DLO: {', '.join(map(str, evaluation.unmatched_ids))}.</p>")
    for verdict in evaluation.moved:
        parts.append(f"<h2>{escape(verdict.name)}</h2>")
        parts.append(_image(error_plot(verdict, truth), f"errors of {verdict.name} over time"))
        t_us = worst_moment(verdict)
        if t_us is not None:
            picture = png_bytes(picture_at(recording, tracks, truth, t_us))
            parts.append(f'<p class="note">Its worst moment, {t_us / 1e6:.3f} s:</p>')
            parts.append(_image(picture, f"estimate and truth of {verdict.name} at its worst moment"))
    parts.append("</body>\n</html>\n")
    return "\n".join(parts)


def _honesty(evaluation: Evaluation) -> list[str]:
    """What sigma and confidence are worth."""
    parts = ["<h2>Honesty</h2>", "<table>\n<tr><th>DLO</th><th>within 1 sigma</th><th>2</th><th>3</th></tr>"]
    for name, shares in [("honest", (0.683, 0.954, 0.997)), *((v.name, v.within_sigma) for v in evaluation.moved)]:
        cells = "".join(f"<td>{_figure(share, 3)}</td>" for share in shares)
        parts.append(f"<tr><td>{escape(name)}</td>{cells}</tr>")
    parts.append("</table>")
    if evaluation.calibration is not None:
        parts.append(f'<p class="note">{escape(evaluation.calibration.summary())}</p>')
        parts.append("<table>\n<tr><th>confidence</th><th>estimates</th><th>wrong</th><th>mean error, mm</th></tr>")
        for row in evaluation.calibration.bins:
            parts.append(
                f"<tr><td>{row.low:.1f} to {row.high:.1f}</td><td>{row.count}</td>"
                f"<td>{100 * row.wrong_share:.1f} %</td><td>{row.error_mm:.2f}</td></tr>"
            )
        parts.append("</table>")
    return parts


def _row(verdict: Verdict) -> str:
    ptc = verdict.ptc_mm
    cells = (
        escape(verdict.name),
        "none" if verdict.id is None else str(verdict.id),
        *(_figure(value, 3) for value in (ptc.mean, ptc.median, ptc.p95, verdict.e_mm.mean, verdict.cov_mm.mean)),
        f"{100 * verdict.lost_fraction:.1f} %",
        str(verdict.id_switches),
        _figure(verdict.lag_ms, 1),
        f"{verdict.rate_hz:.0f}",
        _figure(verdict.nees, 1),
        _figure(verdict.nees_tangent, 1),
        *(_figure(value, 3) for value in verdict.ptc_by_speed_mm.values()),
    )
    kind = "" if verdict.moved else ' class="static"'
    return f"<tr{kind}>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _figure(value: float | None, digits: int) -> str:
    return "&ndash;" if value is None else f"{value:.{digits}f}"


def _image(png: bytes, text: str) -> str:
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{b64encode(png).decode("ascii")}">'
