"""Missions as their files state them, in the files' units. Nothing here knows a world."""
