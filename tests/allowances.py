"""What a session of tests is allowed: so long for each, and so many skipped for a busy machine."""

TIME_LIMIT_S = 600.0  # of a phase of a test; the longest takes a minute, more when it compiles
TIME_LIMIT_SLOW_S = 3600.0  # of one marked slow

SLIPPED = "this machine slipped in each of"  # begins the reason of such a skip
SLIPPED_MAX = 3
"""Tests of a session that may be skipped because the machine did not keep time: half of those that
`make test` asks it of. More, and the session fails: it has not seen flights that keep time."""
