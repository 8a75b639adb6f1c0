"""The frame capture's daemon."""
