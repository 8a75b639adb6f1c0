"""Fusion: scene mode, association of frame instances to tracks, corrections, the state that everyone reads."""
