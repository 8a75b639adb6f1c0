"""Prints where the middle of every cable is now: python follow_cables.py tcp/127.0.0.1:7453 cell1"""

import sys

from motiondlo.client import StateStale, StateSubscriber

endpoint, name = sys.argv[1:3]
with StateSubscriber(endpoint, name, stale_ms=50.0) as cell:
    for state in cell:
        if state.degraded:
            continue
        try:
            cables = state.now()
        except StateStale as stale:
            sys.stderr.write(f"{stale}\n")
            continue
        for cable in cables:
            middle = len(cable.nodes) // 2
            x, y = cable.nodes[middle]
            sys.stdout.write(f"{state.t_us} {cable.ahead_us} {cable.id} {x:.1f} {y:.1f} {cable.sigma_px[middle]:.2f}\n")
            sys.stdout.flush()
