"""Playback of recorded efforts."""
