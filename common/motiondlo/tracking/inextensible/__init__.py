"""Tracker of curves that cannot stretch: a spline of tangent angles in an extended Kalman filter."""
