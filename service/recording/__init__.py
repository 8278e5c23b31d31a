"""Recordings: a run as Rerun entities, the layout they open with, and the viewers. The only room that imports rerun."""
