"""The default event tracker: a Kalman filter over the nodes of a chain."""
