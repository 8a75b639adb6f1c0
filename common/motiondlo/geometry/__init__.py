"""Plane geometry shared by all branches: curves and homographies."""
