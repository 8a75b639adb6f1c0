"""MotionDLO: where the cables are, every few milliseconds.

The library behind the daemons of :mod:`motiondlo_services`: event decoding, tracking, frame segmentation, fusion, the
messages and the bus, the offline tools and the command line.
"""

__version__ = "0.1.0"
