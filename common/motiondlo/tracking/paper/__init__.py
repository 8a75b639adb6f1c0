"""The event tracker of the paper: its pipeline, its parameters, one switch per component."""
