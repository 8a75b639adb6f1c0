"""The gate: the only way into a cell from outside."""
