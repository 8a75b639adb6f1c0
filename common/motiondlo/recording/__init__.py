"""Recordings on disk: the layout that users have, and what is wrong with a given one."""
