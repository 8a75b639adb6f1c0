"""The daemons of a MotionDLO cell: one folder each (``core.py``, ``daemon.py``, ``config.py``)."""
