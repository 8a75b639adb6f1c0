"""The event tracker's daemon."""
