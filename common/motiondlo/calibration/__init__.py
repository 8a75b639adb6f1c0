"""Calibration of a cell: homographies from points, boards or moving cables; reports and pictures of the residuals."""
