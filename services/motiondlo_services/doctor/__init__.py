"""What can be wrong with a machine and a cell, and what to do about it."""
