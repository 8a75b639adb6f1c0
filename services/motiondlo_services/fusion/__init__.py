"""The fusion daemon."""
