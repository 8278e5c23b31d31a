"""One insertion, a step at a time: what is seen, what is commanded, what ends it, and how to go back to a moment."""

from simcore.episode.command import CommandError
from simcore.episode.episode import Episode, EpisodeOverError
from simcore.episode.observation import Observation
from simcore.episode.snapshot import Snapshot, SnapshotError

__all__ = ["CommandError", "Episode", "EpisodeOverError", "Observation", "Snapshot", "SnapshotError"]
