"""One DLO as the paper's tracker holds it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry
from motiondlo.geometry.curve import arc_length, left_normals, resample, tangents
from motiondlo.tracking.paper.hibernation import Hibernation
from motiondlo.tracking.paper.params import PaperParams
from motiondlo.tracking.paper.recovery import RecoveryMonitor
from motiondlo.tracking.paper.registration import Registration, cold_sigma2
from motiondlo.tracking.types import TrackSource, TrackState

FloatArray = npt.NDArray[np.float64]

# Time over which the confidence follows the fit.
_CONFIDENCE_US = 20_000.0


@dataclass(frozen=True)
class PastState:
    """What a late correction is compared with."""

    nodes: FloatArray
    """(M, 2) event px."""
    variance_px2: float
    """Of a node, normal to the curve."""
    moved_us: int
    """How long the DLO had been moving by then, in all."""


@dataclass
class Track:
    """State of one DLO; all arrays are replaced, never changed in place."""

    id: int
    nodes: FloatArray
    """(M, 2) event px, equidistant."""
    diameter_px: float
    rest_length_px: float
    """Known length, 0 where no frame has measured it."""
    params: PaperParams
    hibernation: Hibernation
    recovery: RecoveryMonitor
    velocity_px_s: FloatArray = field(init=False)
    sigma2_px2: float = field(init=False)
    visible: npt.NDArray[np.uint8] = field(init=False)
    beyond_px: FloatArray = field(init=False)
    """(M,) how far each node is from the nearest observation, beyond half a diameter; grows the uncertainty."""
    confidence: float = 1.0
    source: TrackSource = TrackSource.FRAME
    t_corrected_us: int = -1
    fit_px: float = 0.0
    reinitialised: int = 0
    moved_us: int = 0

    def __post_init__(self) -> None:
        self.start(self.nodes)

    def start(self, nodes: FloatArray) -> None:
        """Place the chain anew: at rest, with the cold-start noise variance. nodes: (K, 2) event px with a length."""
        m = self.params.nodes
        self.nodes = resample(nodes, m)
        self.velocity_px_s = np.zeros((m, 2))
        self.sigma2_px2 = cold_sigma2(self.nodes, self.params)
        self.visible = np.ones(m, np.uint8)
        self.beyond_px = np.zeros(m)

    def at_rest(self) -> None:
        """The DLO was found static: the polyline is kept, the velocity is not."""
        self.velocity_px_s = np.zeros_like(self.velocity_px_s)

    def absorb(self, registration: Registration, dt_us: int, judged: npt.NDArray[np.bool_]) -> None:
        """Take over what a registration says: fit, noise variance, visibility, confidence.

        judged: (M,) nodes in the image; the others can have no support.
        """
        self.sigma2_px2 = registration.sigma2_px2
        self.fit_px = registration.residual_px
        self.beyond_px = np.maximum(registration.support - self.diameter_px / 2.0, 0.0)
        supported = registration.support < self.diameter_px
        self.visible = supported.astype(np.uint8)
        share = float(supported[judged].mean()) if judged.any() else 0.0
        self._believe(share * float(np.exp(-registration.residual_px / self.params.drift_px)), dt_us)
        self.source = TrackSource.EVENT

    def unsupported(self, dt_us: int) -> None:
        """An update without observations while moving: predicted, and less sure each time."""
        self.visible = np.zeros(self.params.nodes, np.uint8)
        self._believe(0.0, dt_us)
        self.source = TrackSource.PREDICTED

    def _believe(self, fit: float, dt_us: int) -> None:
        weight = 1.0 - float(np.exp(-dt_us / _CONFIDENCE_US))
        self.confidence += weight * (fit - self.confidence)

    def in_image(self, geometry: SensorGeometry) -> npt.NDArray[np.bool_]:
        """(M,) nodes inside the sensor."""
        high = [geometry.width_px - 1, geometry.height_px - 1]
        return np.asarray(((self.nodes >= 0.0) & (self.nodes <= high)).all(axis=1))

    def variance_px2(self) -> float:
        """Variance of a node normal to the curve: the registration's own noise estimate."""
        return self.sigma2_px2

    def past(self) -> PastState:
        """The state to remember for late corrections."""
        return PastState(self.nodes, self.variance_px2(), self.moved_us)

    def state(self) -> TrackState:
        """The track as published.

        Covariance: the registration's noise variance across the curve, widened where no observation was near; along the
        curve half a node spacing, because that is how far the E-step lets nodes slide.
        """
        t = tangents(self.nodes)
        n = left_normals(t)
        spacing = float(arc_length(self.nodes)[-1]) / (len(self.nodes) - 1)
        across = self.variance_px2() + self.beyond_px**2
        along = across + (spacing / 2.0) ** 2
        cov = np.empty((len(self.nodes), 3))
        for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1))):
            cov[:, k] = along * t[:, i] * t[:, j] + across * n[:, i] * n[:, j]
        return TrackState(
            id=self.id,
            nodes=self.nodes,
            velocity_px_s=self.velocity_px_s,
            cov_px2=cov,
            visible=self.visible,
            diameter_px=self.diameter_px,
            confidence=float(np.clip(self.confidence, 0.0, 1.0)),
            moving=self.hibernation.moving,
            source=self.source,
            t_corrected_us=self.t_corrected_us,
            fit_px=self.fit_px,
            reinitialised=self.reinitialised,
        )
