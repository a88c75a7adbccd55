"""Which frames are believed: the receiver, the gates, the navigation set of a cycle, requests."""
